"""One recipe, the whole chain: campaign, FRFs, modes, shapes, findings, report."""
