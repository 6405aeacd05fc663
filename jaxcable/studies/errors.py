"""Errors of studies: what could not be computed or written; all other chunks are in the store."""


class StudyError(RuntimeError):
    """Chunks of a study could not be computed or written."""


class ClusterLostError(StudyError):
    """The scheduler of a cluster, or the connection to it, was lost during a study."""
