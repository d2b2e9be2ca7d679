"""Small predict and correct steps that the filters of this package are short differences of.

``kalman`` is the linear and the extended filter, ``unscented`` the sigma points, ``strong_tracking`` the
fading factors, ``harmonic_model`` the signal that the harmonic filters assume.  All are ``@njit``, change
their arguments in place and allocate nothing but what they say.
"""
