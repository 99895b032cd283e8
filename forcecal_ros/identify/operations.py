"""What the procedure costs."""


def operation_count(times: tuple[float, float, float, float, float], rate: float) -> float:
    """
    Arithmetic operations of the plain procedure, [Gamez2005] Eq. 20.

    Parameters
    ----------
    times : tuple of float
        t0 to t4: pose 1 from t0 to t1, pose 3 from t2 to t3, the step until t4 [s].
    rate : float
        Samples per second.

    Returns
    -------
    float
    """
    t0, t1, t2, t3, t4 = times
    return ((t1 - t0) + 2 * (t3 - t2) + (t4 - t3)) * rate
