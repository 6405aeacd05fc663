"""Hard cases: what is singular, extreme or at the edge, with what has to come out, and why.

Each case is built at a small size (for the tests) or at full size (`experiments/hard_cases.py`) in
either precision. Its outcome is a status, the check of `independent.verdict` where that is OK, and
a figure from elsewhere: a closed form, digits by mpmath, a symmetry. Cases of one shape share a
compiled program.
"""

import dataclasses

from banks.hard_elements import drawn, pulled, shakedown, snap_back, steep, traced, von_mises
from banks.hard_nets import (
    elastic_cycles,
    loose_node,
    many_increments,
    net,
    reversed_net,
    rollers,
    two_links,
    unequal_links,
)

from jaxcable.common import status


@dataclasses.dataclass(frozen=True)
class Case:
    """A hard case.

    Attributes:
        name: what it is.
        build: function of (full, dtype) to `Problem`.
        reason: why it is hard, and what is expected.
        single: statuses allowed in float32, with `double` those in float64.
        slow: precisions that are tested with the slow tests only: programs of their own.
    """

    name: str
    build: object
    reason: str
    double: tuple = (status.OK,)
    single: tuple = (status.OK,)
    slow: tuple = ()

    def allowed(self, dtype):
        return self.double if dtype == "float64" else self.single


PAIR = ("float64", "float32")

CASES = [
    Case(
        "two links without prestress",
        two_links(0.0, 1e-6),
        "tangent singular at the start",
        slow=PAIR,
    ),
    Case("two links, prestress 1e-12 EA", two_links(1e-12, 1e-6), "nearly singular tangent"),
    Case("two links, EA/N = 1e8", two_links(1e-8, 3e-12), "N is the small difference of lengths"),
    Case("two links, EA/N = 1e12", two_links(1e-12, 1e-18), "beyond the digits of a length"),
    Case("two links 1e6 m away", two_links(1e-4, 1e-6, offset=1e6), "positions lose digits"),
    Case("links of 1 m and 1e5 m", unequal_links, "stiffnesses 1e5 apart"),
    Case("flat net without prestress", net(0.0, 1e-5), "tangent singular at the start", slow=PAIR),
    Case("net, prestress 1e-12 EA", net(1e-12, 1e-5), "nearly singular tangent"),
    Case("net, EA/N = 1e8", net(1e-8, 1e-12), "small difference of lengths"),
    Case("net, EA/N = 1e12", net(1e-12, 1e-18), "small difference of lengths"),
    Case("net, lengths 1e5 apart", net(1e-3, 1e-5, stretch=1e5), "stiffnesses 1e5 apart"),
    Case("net 1e6 m away", net(1e-3, 1e-5, offset=1e6), "positions lose digits"),
    Case(
        "net with every cable slack",
        net(-0.2, 1e-5),
        "no stiffness at the start; in float32 EA eps of displacements of 0.5 m is 0.6 N, of 100 N",
    ),
    Case("slack net drawn down, then up", reversed_net, "slack on the way", slow=PAIR),
    Case("node with only slack cables", loose_node, "no equation for it", slow=PAIR),
    Case(
        "cables on rollers",
        rollers,
        "no equilibrium",
        (status.MECHANISM,),
        (status.MECHANISM,),
        slow=PAIR,
    ),
    Case("truss pushed through", von_mises, "negative stiffness, held", slow=PAIR),
    Case("truss pushed by a spring", snap_back, "jumps to the only equilibrium left", slow=PAIR),
    Case("limit load by arc length", traced(False), "limit point", slow=PAIR),
    Case("snap-back by arc length", traced(True), "displacement turns back", slow=PAIR),
    Case("cable at the corner of its curve", pulled(2e6, 1, 1, 1e-3), "two tangents", slow=PAIR),
    Case(
        "cable pulled beyond its peak",
        pulled(4e6, 16, 12 / 16),
        "3e6 N is the peak: carried at 12/16 of the load, not at 13/16",
        (status.MATERIAL_FAILURE,),
        (status.MATERIAL_FAILURE,),
        slow=PAIR,
    ),
    Case("cable drawn down its falling branch", drawn(4e-3, 16, 1), "negative tangent", slow=PAIR),
    Case(
        "cable drawn beyond its end",
        drawn(8.1e-3, 16, 9 / 16),
        "5e-3 is the end: 9/16 of the movement, not 10/16",
        (status.MATERIAL_FAILURE,),
        (status.MATERIAL_FAILURE,),
        slow=PAIR,
    ),
    Case("100 elastic cycles", elastic_cycles, "nothing may add up", slow=PAIR),
    Case("100 elastic-plastic cycles", shakedown, "shakes down", slow=PAIR),
    Case("435 increments against one", many_increments, "one equilibrium", slow=PAIR),
    Case("plumb catenary, taut", steep(-0.5), "no span", slow=PAIR),
    Case("plumb catenary in a loop", steep(5.0), "horizontal force near zero", slow=PAIR),
]
