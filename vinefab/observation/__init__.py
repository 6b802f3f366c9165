"""A grown robot on a photo against its prediction, and what photos say of assumed numbers."""
