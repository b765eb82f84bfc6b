"""Lightmaps for USD scenes, batches of assets and render farms, baked by the program `lightkiln`."""

__version__ = "0.1.0"
