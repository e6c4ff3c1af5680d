"""Random hosts, beams and joints: predicted from noisy FRFs, then computed in time by a program of its own."""
