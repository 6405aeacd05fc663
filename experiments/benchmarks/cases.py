"""The cases of all benchmarks: nets, scenes, solvers, counts; a smaller choice for `--quick`."""

from typing import NamedTuple


class Cases(NamedTuple):
    """Cases of all benchmarks.

    Attributes:
        sides: free nodes on a side of saddle nets beside OpenSees.
        solvers: of these nets, with the largest side that each of them has.
        batches: load cases of a net of 48 unknowns, plain and with fused loops.
        hard: free nodes on a side of the net with slack cables.
        evaluated: scenes whose first calls outside of jit are measured; the first in all kinds.
        compiled: those that are measured with XLA alone, too.
        called: scenes and kinds of which many calls are measured.
        evaluated_calls: numbers of calls.
        nets: nets of different shape that one process analyses.
        gradients: free nodes on a side, and pairs of calls.
        increments: of the loading phase of a gradient.
        precision: tolerances of Newton's method.
        corrections, secant: increments of the incremental methods, by number of corrections.
        straight: elements on each side of the isolated cable.
        fibres: on a side of a round section.
        repeats: calls by turns.
        forms: free nodes on a side of nets whose force densities are given.
        study: load cases of the study, those of a chunk, chunks of nothing, threads that sleep.
        whole: whether all commands and programs of `commands` run.
        waiting: calls of each program, and of the control.
        frames: load cases of a frame, and calls of each way to solve them.
        installs: interpreters of Python into which the wheel is installed.
        gpu: sizes of batches, of dense and of sparse nets.
    """

    sides: tuple
    solvers: dict
    batches: tuple
    hard: int
    evaluated: tuple
    compiled: tuple
    called: tuple
    evaluated_calls: tuple
    nets: int
    gradients: dict
    increments: tuple
    precision: tuple
    corrections: dict
    secant: tuple
    straight: tuple
    fibres: tuple
    repeats: int
    forms: tuple
    study: tuple
    whole: bool
    waiting: tuple
    frames: tuple
    installs: int
    gpu: tuple


FULL = Cases(
    sides=(4, 10, 20, 50, 100, 200, 577),
    solvers={"pardiso": 577, "cholmod": 200, "superlu": 200},
    batches=(100, 1000, 10_000, 100_000),
    hard=100,
    evaluated=(
        *("flat_net", "hypar_net", "geiger_dome", "isolated_cable", "suspended_cable"),
        *("strung_arch", "guyed_mast", "cable_stayed_bridge"),
    ),
    compiled=("flat_net", "guyed_mast"),
    called=(("flat_net", "plain"), ("guyed_mast", "plain"), ("flat_net", "batch")),
    evaluated_calls=(1, 3, 10, 100, 1000),
    nets=500,
    gradients={2: 201, 10: 61, 20: 61},
    increments=(1, 10, 100),
    precision=(1e-1, 1e-2, 1e-3, 1e-5, 1e-7, 1e-9, 1e-12),
    corrections={0: (16, 256), 1: (1, 4, 16), 2: (1, 2)},
    secant=(64, 256),
    straight=(16, 64, 256),
    fibres=(8, 32, 64),
    repeats=9,
    forms=(30, 100, 200),
    study=(100_000, 500, 1_000, 50),
    whole=True,
    waiting=(50, 500),
    frames=(1000, 3),
    installs=9,
    gpu=((1000, 10_000, 100_000), (4, 10, 20), (100, 200)),
)
QUICK = Cases(
    sides=(4,),
    solvers={"superlu": 200},
    batches=(10,),
    hard=4,
    evaluated=("flat_net",),
    compiled=(),
    called=(("flat_net", "plain"),),
    evaluated_calls=(1, 3),
    nets=2,
    gradients={2: 3},
    increments=(1,),
    precision=(1e-1, 1e-9),
    corrections={1: (1,)},
    secant=(4,),
    straight=(2,),
    fibres=(4,),
    repeats=2,
    forms=(4,),
    study=(40, 10, 20, 2),
    whole=False,
    waiting=(1, 2),
    frames=(10, 2),
    installs=0,
    gpu=((10,), (4,), ()),
)

SMALL, LARGE, ANY = range(1, 21), range(21, 201), range(1, 201)  # sides
SYSTEMS = [  # of OpenSees: system, numberer, algorithm, and for which sides
    ("BandSPD", "RCM", "Newton", SMALL),
    ("ProfileSPD", "RCM", "Newton", SMALL),
    ("SparseSYM", "Plain", "Newton", ANY),
    ("SparseSYM", "Plain", "ModifiedNewton", ANY),
    ("BandSPD", "RCM", "ModifiedNewton", SMALL),
    ("UmfPack", "Plain", "Newton", ANY),
    ("Mumps", "Plain", "ModifiedNewton", LARGE),
]
HARD = {  # how OpenSees may find a net with slack cables
    "corotTruss, Newton": {"algorithm": "Newton"},
    "corotTruss, NewtonLineSearch": {"algorithm": "NewtonLineSearch"},
    "corotTruss without compression, Newton": {"algorithm": "Newton", "compression": 0.0},
}
