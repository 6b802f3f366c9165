"""Design rules: design, outline and profile in, findings out; the penalty and the fix."""
