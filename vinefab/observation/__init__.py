"""A grown robot on a photo against its prediction, and evidence of photos on assumed numbers."""
