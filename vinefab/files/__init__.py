"""The only room that reads files; designs, maps, profiles and runs also leave through it."""
