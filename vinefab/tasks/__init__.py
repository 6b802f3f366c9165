"""What a deployment is worth: one file per task, and their composition over maps and poses."""
