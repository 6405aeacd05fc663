"""Random structures of all banks but that of nets: they converge, as statics of their own say.

The studies `experiments/bar_bank.py`, `contact_bank.py`, `unsymmetric_bank.py` and
`friction_bank.py` run more of these scenes; here are some of each kind.
"""

import jax
import numpy as np
import pytest
from banks import bar_bank, contact_bank, friction_bank, unsymmetric_bank

import jaxcable as jc
from jaxcable.common.tree import copy_with

# structures of random forces, some of which move far, or turn freely under none
pytestmark = pytest.mark.filterwarnings(
    "ignore:node .* has moved", "ignore::jaxcable.UnstableWarning"
)

BANKS = {  # seeds of each kind; a figure of the steps of all increments, and its bound
    "bars": (bar_bank, 12, np.max, 80),  # 99 % of thousands take 60 or fewer
    "contacts": (contact_bank, 8, np.max, 200),
    "unsymmetric": (unsymmetric_bank, 12, np.median, 50),  # medians by kind are from 4 to 28
    "friction": (friction_bank, 7, np.median, 6),  # medians are from 3 to 5
}
NOT_FOUND = {("coiled", 4), ("coiled", 9), ("stayed", 1), ("masts", 0), ("long", 3)}
"""Kinds and seeds that take more than 200 steps, or more increments."""


def false_judgements(bank, one, solution):
    """Judgements of other results, or by other numbers of ropes, which have to refuse them."""
    if bank == "unsymmetric":
        return [unsymmetric_bank.judged(one, unsymmetric_bank.moved_apart(one, solution))]
    if bank == "friction":
        changes = {"axial_stiffness": 1.001}, dict.fromkeys(COEFFICIENTS, 0.98)
        others = [friction_bank.with_other_ropes(one, **factors) for factors in changes]
        return [friction_bank.judged(other, solution) for other in others]
    if bank == "contacts":
        moved = copy_with(solution, displacement=1.001 * solution.displacement)
        return [contact_bank.judged(one, moved)]
    tension = jax.tree.map(lambda force: 1.001 * force, solution.tension)
    moved = copy_with(solution, reactions=1.001 * solution.reactions, tension=tension)
    return [bar_bank.judged(one, moved)]


COEFFICIENTS = "friction", "axle_friction", "wobble"
QUICK = "bars-string", "bars-prism", "contacts-stopped", "contacts-prism", "unsymmetric-towed"
# contacts of the kind "mixed" are in `test_random_contacts.py`
CASES = [(bank, kind) for bank in BANKS for kind in BANKS[bank][0].KINDS]
CASES.remove(("contacts", "mixed"))


@pytest.mark.quick_cases(*QUICK)
@pytest.mark.parametrize(("bank", "kind"), CASES)
def test_structures_converge(bank, kind):
    """No wrong OK; and a judgement can fail."""
    module, seeds, figure, most = BANKS[bank]
    steps, refused = [], 0
    for seed in range(seeds):
        one = module.drawn(kind, seed)
        solution = jc.solve(one.structure, one.phases)
        result = module.judged(one, solution)
        assert not result.wrong, (seed, one.ratio, result)
        if (kind, seed) in NOT_FOUND:
            continue
        assert result.code == jc.status.OK, (seed, one.ratio, result)
        refused += all(judged.wrong for judged in false_judgements(bank, one, solution))
        steps.append(result.steps)
    assert figure(np.concatenate(steps)) <= most
    # scenes without loads and ropes that do not slip are right all the same
    assert refused >= (len(steps) if bank == "unsymmetric" else 5)
