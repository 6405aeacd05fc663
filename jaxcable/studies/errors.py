"""Errors of studies: what could not be computed or written; all other chunks are in the store."""


class StudyError(RuntimeError):
    """Chunks of a study could not be computed or written; all others are in the store.

    Example:
        >>> import tempfile, pathlib
        >>> store = pathlib.Path(tempfile.mkdtemp()) / "a.zarr"
        >>> def refuse(numbers):
        ...     if numbers[0] == 20:
        ...         raise OSError("the file of cases is gone")
        ...     return numbers.astype(float)
        >>> cases = jc.studies.samples(refuse, 40)
        >>> try:
        ...     _ = jc.study(lambda x: {"double": 2 * x}, cases, store, chunk=10)
        ... except jc.studies.StudyError as error:
        ...     print(str(error).partition("a.zarr: ")[2].partition(";")[0])
        chunk 2 (cases 20 to 29): OSError: the file of cases is gone
        >>> jc.studies.Study(store).missing
        [2]
    """


class ClusterLostError(StudyError):
    """The scheduler of a cluster, or the connection to it, was lost during a study.

    Example:
        >>> issubclass(jc.studies.ClusterLostError, jc.studies.StudyError)
        True
    """
