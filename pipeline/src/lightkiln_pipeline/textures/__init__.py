"""Textures for engines and renderers, made of lightmap pages."""
