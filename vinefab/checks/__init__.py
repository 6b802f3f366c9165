"""Design rules: outline, design and profile in, findings out."""
