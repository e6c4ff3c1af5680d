"""Two FRFs with poor coherence and a published answer (repository named in the datasets' README; not part of this one)."""

import pytest

from ema.data import FrfSet
from ema.dof import Dof
from ema.estimate import quality


@pytest.mark.parametrize(("case", "peak", "tolerance"), [(1, 212.0925, 0.2), (2, 192.594, 0.3)])
def test_poor_coherence_is_found_at_the_published_resonance(datasets, case, peak, tolerance):
    from scipy.io import loadmat

    file = loadmat(datasets / "08_sdof_frfs_with_published_answer" / f"case{case}.mat")
    frfs = FrfSet(
        file["Freq_domain"].ravel().astype(float),
        file["Hf_chan_2"].astype(complex)[:, :, None],
        (Dof(2),),
        (Dof(1),),
        "unstated",
        coherence=file["Hf_coh_chan_2"].astype(float)[:, :, None],
        name=f"case {case}",
    )
    low = [finding for finding in quality(frfs.band(150, 250)) if finding.code == "low-coherence"]
    at = [(float(f.where.split()[-2]), f) for f in low if f.where.endswith("Hz")]
    near = [f for frequency, f in at if abs(frequency - peak) < tolerance + frfs.frequency_step]
    assert near, [f.where for f in low]
    assert near[0].severity == "warning"
    assert 0 < near[0].value < 0.8
    assert any("median" in f.message for f in low)
