"""The recursions of the Kalman filter and smoother of :mod:`frictionpinn.numerics.kalman`, compiled."""

import numba
import numpy as np

PRIOR = 100.0  # prior standard deviation of the first state, relative to each signal's root mean square


@numba.njit(cache=True)
def transition(h, density, F, Q):
    """Write the transition matrix and the process noise covariance over a step ``h``."""
    n = F.shape[0]
    factorial = np.array([1.0, 1.0, 2.0, 6.0, 24.0])
    for i in range(n):
        for j in range(n):
            F[i, j] = h ** (j - i) / factorial[j - i] if j >= i else 0.0
            power = 2 * n - 1 - i - j
            Q[i, j] = density * h**power / (factorial[n - 1 - i] * factorial[n - 1 - j] * power)


@numba.njit(cache=True)
def predict(F, Q, x, P, work):
    """Advance mean and covariance by one step, in place."""
    n = len(x)
    for i in range(n):
        for j in range(n):
            work[i, j] = 0.0
            for k in range(i, n):
                work[i, j] += F[i, k] * P[k, j]
    for i in range(n):
        mean = 0.0
        for k in range(i, n):
            mean += F[i, k] * x[k]
        x[i] = mean
    for i in range(n):
        for j in range(i, n):
            entry = Q[i, j]
            for k in range(j, n):
                entry += work[i, k] * F[j, k]
            P[i, j] = entry
            P[j, i] = entry


@numba.njit(cache=True)
def correct(y, variances, x, P, gains, errors, spreads):
    """Take in the signals of one sample one after another; return their log-likelihood."""
    n, loglik = len(x), 0.0
    for c in range(3):
        spreads[c] = 0.0
        if np.isnan(y[c]) or np.isnan(variances[c]) or P[c, c] + variances[c] <= 0:
            continue
        s = P[c, c] + variances[c]
        e = y[c] - x[c]
        for i in range(n):
            gains[c, i] = P[i, c] / s
        for i in range(n):
            x[i] += gains[c, i] * e
            for j in range(i, n):
                P[i, j] -= gains[c, i] * gains[c, j] * s
                P[j, i] = P[i, j]
        errors[c], spreads[c] = e, s
        loglik -= 0.5 * (np.log(2 * np.pi * s) + e * e / s)
    return loglik


@numba.njit(cache=True)
def forward(t, y, density, variances, deviations, jumps, smooth):
    """Return log-likelihood, states (n, size) and jump scores (n,) of a trial, smoothed where ``smooth``.

    The smoother gives the Rauch-Tung-Striebel estimates in the modified Bryson-Frazier form, which inverts no
    covariance (Bierman, 1973). ``jumps`` marks the samples before which the acceleration may jump.
    """
    n, size = len(t), len(deviations)
    x, P = np.zeros(size), np.diag(deviations**2)
    F, Q, work = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size))
    means, predicted, covariances = np.zeros((n, size)), np.zeros((n, size)), np.zeros((n, size, size))
    gains, errors, spreads = np.zeros((n, 3, size)), np.zeros((n, 3)), np.zeros((n, 3))
    loglik, step, scores = 0.0, -1.0, np.zeros(n)
    for k in range(n):
        if k > 0:
            if t[k] - t[k - 1] != step:
                step = t[k] - t[k - 1]
                transition(step, density, F, Q)
            predict(F, Q, x, P, work)
            if jumps[k]:
                jump(step, P, deviations / PRIOR)
        for i in range(size):  # a slice assignment takes seconds to compile
            predicted[k, i] = x[i]
            for j in range(size):
                covariances[k, i, j] = P[i, j]
        loglik += correct(y[:, k], variances, x, P, gains[k], errors[k], spreads[k])
        for i in range(size):
            means[k, i] = x[i]
    if smooth:
        backward(t, density, predicted, covariances, gains, errors, spreads, means, scores)
    return loglik, means, scores


@numba.njit(cache=True)
def jump(h, P, deviations):
    """Let the acceleration jump at any time in the step ``h``, and the higher derivatives with it."""
    spread = deviations[2] ** 2
    moments = np.array([[h**4 / 20, h**3 / 8, h**2 / 6], [h**3 / 8, h**2 / 3, h / 2], [h**2 / 6, h / 2, 1.0]])
    for i in range(3):
        for j in range(3):
            P[i, j] += spread * moments[i, j]
    for i in range(3, len(P)):
        P[i, i] += deviations[i] ** 2


@numba.njit(cache=True)
def inform(information, gain, spread, c):
    """Replace N by e_c e_c' / s + L' N L with L = I - K e_c', in place."""
    size = len(gain)
    column = np.zeros(size)
    for i in range(size):
        for j in range(size):
            column[i] += information[i, j] * gain[j]
    centre = 1.0 / spread
    for i in range(size):
        centre += gain[i] * column[i]
    for i in range(size):
        information[i, c] -= column[i]
        information[c, i] -= column[i]
    information[c, c] += centre


@numba.njit(cache=True)
def backward(t, density, predicted, covariances, gains, errors, spreads, means, scores):
    """Overwrite the filtered ``means`` by the smoothed ones and ``scores`` by the evidence of jumps."""
    n, size = means.shape
    information = np.zeros((size, size))
    F, Q, adjoint, before = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size), np.zeros(size)
    for k in range(n - 1, -1, -1):
        for c in range(2, -1, -1):
            if spreads[k, c] > 0:
                change = errors[k, c] / spreads[k, c]
                for i in range(size):
                    change -= gains[k, c, i] * adjoint[i]
                adjoint[c] += change
                inform(information, gains[k, c], spreads[k, c], c)
        if information[2, 2] > 0:
            scores[k] = adjoint[2] ** 2 / information[2, 2]
        for i in range(size):
            means[k, i] = predicted[k, i]
            for j in range(size):
                means[k, i] += covariances[k, i, j] * adjoint[j]
        if k > 0:
            transition(t[k] - t[k - 1], density, F, Q)
            for i in range(size):
                before[i] = 0.0
                for j in range(i + 1):
                    before[i] += F[j, i] * adjoint[j]
            for i in range(size):
                adjoint[i] = before[i]
            information = F.T @ information @ F
