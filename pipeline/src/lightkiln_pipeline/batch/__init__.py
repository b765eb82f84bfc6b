"""Batches: a manifest of assets → lightmaps for what changed, and a report."""
