"""What a deployment is worth: tasks, and their composition over maps and poses."""
