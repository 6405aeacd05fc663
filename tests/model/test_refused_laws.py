"""Points and numbers that no law can be made of are refused, with a message that names them."""

import numpy as np
import pytest

import jaxcable as jc
from jaxcable import materials

BAD = {
    "one point": (([0.0], [0.0]), r"strain: expected shape \[n\] with n >= 2, got \(1,\)"),
    "rank": (([[0.0, 1.0]], [[0.0, 1.0]]), r"strain: expected shape \[n\] with n >= 2"),
    "lengths": (([0, 1e-3], [0, 1e8, 2e8]), r"stress: expected shape \(2,\) as strain, got \(3,\)"),
    "words": (([0, 1e-3], ["a", "b"]), "stress: expected numbers"),
    "complex": (([0, 1e-3j], [0, 1e8]), "strain: expected real numbers"),
    "ragged": (([[0], [1, 2]], [0, 1e8]), "strain: not a rectangular array"),
    "unloading": (([0, 1e-3], [0, 1e8], "memory"), "unloading = 'memory': expected"),
    "order": (
        ([0, 2e-3, 1e-3], [0, 1e8, 2e8]),
        r"strain\[2\] = 0.001: must be above strain\[1\] = 0.002",
    ),
    "twice": (([0, 1e-3, 1e-3], [0, 1e8, 2e8]), r"strain\[2\] = 0.001: must be above strain\[1\]"),
    "infinite": (([0, np.inf], [0, 1e8]), r"strain\[1\] = inf: must be finite"),
    "other sign": (
        ([0, 1e-3, 2e-3], [0, 1e8, -1e8]),
        r"stress\[2\] = -100000000.0: of the other sign than its strain",
    ),
    "all tension": (([1e-3, 2e-3], [1e8, 2e8]), "strain: goes from 0.001 to 0.002"),
    "all compression": (([-2e-3, -1e-3], [-2e8, -1e8]), "strain: goes from -0.002 to -0.001"),
    "no tension": (([-2e-3, 0], [-2e8, 0]), "strain: goes from -0.002 to 0.0; .* pass the origin"),
    "origin": (([-1e-3, 0, 1e-3], [-1e8, 5.0, 1e8]), r"stress\[1\] = 5.0: at zero strain"),
    "misses": (([-1e-3, 1e-3], [-1e8, 2e8]), "the curve has 5e.07 Pa at zero strain"),
    "slope": (([0, 1e-3, 2e-3], [0, -1e8, 1e8]), "slope at the origin, -1e.11 Pa, must be positiv"),
    "slope behind": (([-1e-3, 0, 1e-3], [1e8, 0, 1e8]), "slope at the origin, -1e.11 Pa"),
    "convex": (
        ([0, 1e-3, 2e-3, 3e-3], [0, 1e8, 1.5e8, 3e8], "elastic"),
        r"stress\[2\]: elastic unloading needs a concave curve",
    ),
    "convex behind": (
        ([-3e-3, -2e-3, -1e-3, 0, 1e-3], [-3e8, -1.5e8, -1e8, 0, 1e8], "elastic"),
        r"stress\[1\]: elastic unloading needs a concave curve",
    ),
    "falling": (
        ([0, 1e-3, 2e-3], [0, 1e8, 0.5e8], "elastic"),
        r'stress\[1\]: elastic unloading needs .* use unloading="reversible"',
    ),
    "unequal": (
        ([-2e-3, 0, 1e-3], [-1e8, 0, 1e8], "elastic"),
        "segment 0 from the origin has 1e.11 and 5e.10 Pa",
    ),
    "unequal later": (
        ([-2e-3, -1e-3, 0, 1e-3, 2e-3], [-1.5e8, -1e8, 0, 1e8, 1.2e8], "elastic"),
        "segment 1 from the origin has 2e.10 and 5e.10 Pa",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_points_are_refused(name):
    arguments, message = BAD[name]
    with pytest.raises(ValueError, match=message):
        jc.Polygonal(*arguments)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: jc.Elastic(-1.0), "E = -1.0: Young's modulus must be positive"),
        (lambda: jc.Elastic(0), "E = 0.0: Young's modulus must be positive"),
        (lambda: jc.Elastic([1.0, 2.0]), r"E: expected a scalar .* got shape \(2,\)"),
        (lambda: jc.Elastic("soft"), "E: expected numbers"),
        (
            lambda: materials.steel(ultimate_strain=1e-3),
            r"strain\[1\] .* must be above strain\[0\]",
        ),
        (lambda: materials.steel(hardening=-0.01), r"stress\[0\]: elastic unloading needs"),
        (lambda: materials.strand(ultimate_strain=5e-3), r"strain\[2\] = 0.005: must be above"),
    ],
)
def test_bad_numbers_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_nan_in_the_points_is_no_error_but_gives_nan():
    """A batch survives it; an analysis turns it into a status."""
    law = jc.Polygonal([0, 1e-3, 2e-3], [0, np.nan, 2e8])
    assert np.isnan(law.stress_at(5e-4))
