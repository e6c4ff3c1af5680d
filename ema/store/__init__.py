"""Our one file format (HDF5)."""
