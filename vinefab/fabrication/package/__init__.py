"""The folder that a technician gets: instructions, bill of materials, pictures, manifest."""
