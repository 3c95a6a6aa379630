"""What the world is: scenes, goals and liquids; where scenes come from; files of them."""
