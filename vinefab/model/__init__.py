"""The nouns: frozen, validated, without input, output or plotting."""
