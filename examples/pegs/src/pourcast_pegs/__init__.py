"""An experiment for pourcast, with a goal, a scene family and a liquid of its own."""
