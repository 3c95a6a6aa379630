"""What pours a liquid for the pictures: one file each."""
