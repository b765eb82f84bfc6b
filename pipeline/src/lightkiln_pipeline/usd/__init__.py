"""USD: scenes become what the baker reads, and its lightmaps come back as a layer over the source."""
