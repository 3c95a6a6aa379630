"""What participants are shown: stills, films of what happens, and the list of both."""
