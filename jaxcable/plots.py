"""Pictures (matplotlib)."""


def net(solution):
    raise NotImplementedError
