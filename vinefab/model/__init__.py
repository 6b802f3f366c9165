"""The nouns that several rooms share: frozen, validated, and their file forms beside them."""
