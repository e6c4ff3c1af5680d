"""The friction-beam simulator and the virtual rig."""
