"""Changes of an input path with quantities of the caller's: at any time a few act, each as a polynomial."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..errors import UserError
from .paths import DEGREE, InputPath, at_samples
from .polynomials import unfolded
from .spline_basis import LANES, PathBasis


@dataclass(frozen=True)
class Directions:
    """Derivatives of an input path with respect to quantities of the caller's, made ready once for many simulations.

    Those that act together are evaluated together, as many as B-splines act between two knots: in the interval k

        du/dc_j (t) = sum_m pieces[i, :, m, lane] (t - t_k + since[g, k])^m,    i = piece[g, k],    j = lanes[i, lane],

    of every group g that acts there.

    Attributes:
        names: of the quantities, as given.
        t: sample times, s, shape (n,).
        pieces: shape (pieces, n_u, 6, LANES).
        lanes: which direction each lane of a piece is, by the interval where each first acts, or -1.
        groups: first and last interval in which each group acts, its first input and how many, shape (groups, 4).
        piece, since: of every group and interval, shape (groups, n - 1).
        support: first and last interval in which each direction acts, shape (n_d, 2), the first increasing.
        order: place of each name among these, shape (n_d,).
    """

    names: tuple[str, ...]
    t: np.ndarray
    pieces: np.ndarray
    lanes: np.ndarray
    groups: np.ndarray
    piece: np.ndarray
    since: np.ndarray
    support: np.ndarray
    order: np.ndarray

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    @classmethod
    def of(cls, paths: Mapping[str, InputPath], path: InputPath) -> Directions:
        """Derivatives of ``path`` given as paths.

        Raises:
            UserError: one on other times than the path.
        """
        for name, own in paths.items():
            if own.coefficients.shape != path.coefficients.shape:
                raise UserError("direction on other times than the path", where=f"directions.{name}")
        given = np.zeros((0, *path.coefficients.shape))
        if paths:
            given = np.stack([own.coefficients for own in paths.values()])
        support = _support(given)
        place = np.argsort(support[:, 0], kind="stable")
        return cls.between_samples(tuple(paths), path.t, given[place], support[place], np.argsort(place))

    @classmethod
    def between_samples(
        cls, names: tuple[str, ...], t: np.ndarray, coefficients: np.ndarray, support: np.ndarray, order: np.ndarray
    ) -> Directions:
        """Of other polynomials between any two samples, shape (n_d, n - 1, n_u, 6), by where each first acts."""
        count, n, n_u, _ = coefficients.shape
        pieces, lanes = [np.zeros((0, n_u, DEGREE + 1, LANES))], [np.zeros((0, LANES), np.int64)]
        begins = range(0, count, LANES)
        groups, piece = np.zeros((len(begins), 4), np.int64), np.zeros((len(begins), n), np.int64)
        for g, begin in enumerate(begins):
            own = np.arange(begin, min(begin + LANES, count))
            first, last = support[own, 0].min(), support[own, 1].max()
            intervals = np.arange(first, last + 1)
            groups[g] = first, last, 0, n_u
            piece[g, intervals] = sum(len(made) for made in pieces) + intervals - first
            acting = np.zeros((len(intervals), n_u, DEGREE + 1, LANES))
            acting[..., : len(own)] = np.moveaxis(coefficients[np.ix_(own, intervals)], 0, -1)
            pieces.append(acting)
            lanes.append(np.tile(np.pad(own, (0, LANES - len(own)), constant_values=-1), (len(intervals), 1)))
        together = np.concatenate(pieces), np.concatenate(lanes)
        return cls(names, t, *together, groups, piece, np.zeros(piece.shape), support, order)

    @classmethod
    def of_splines(cls, t: np.ndarray, n_u: int, splines: Sequence[tuple[str, Sequence[int], PathBasis]]) -> Directions:
        """In the coefficients of splines: the name, inputs and basis of each."""
        names = tuple(f"{name}[{j}]" for name, _, basis in splines for j in range(basis.size))
        support = np.concatenate([np.zeros((0, 2), np.int64), *(basis.support for *_, basis in splines)])
        place = np.argsort(support[:, 0], kind="stable")
        order, n = np.argsort(place), len(t) - 1
        groups = np.array([[0, n - 1, min(at), max(at) + 1 - min(at)] for _, at, _ in splines], np.int64).reshape(-1, 4)
        pieces, lanes = [np.zeros((0, n_u, DEGREE + 1, LANES))], [np.zeros((0, LANES), np.int64)]
        piece, since = np.zeros((len(splines), n), np.int64), np.zeros((len(splines), n))
        for g, (_, columns, basis) in enumerate(splines):
            begun, count = order[sum(own.size for *_, own in splines[:g]) :], len(basis.pieces)
            own = np.zeros((count, n_u, DEGREE + 1, LANES))
            own[:, list(columns)] = basis.pieces
            breaks = np.array(basis.breaks)
            at = np.repeat(np.arange(count), np.diff(breaks))
            piece[g], since[g] = sum(len(made) for made in pieces) + at, t[:-1] - t[breaks[at]]
            pieces.append(own)
            lanes.append(begun[np.arange(count)[:, None] + np.arange(LANES)])
        return cls(names, t, np.concatenate(pieces), np.concatenate(lanes), groups, piece, since, support[place], order)

    @cached_property
    def coefficients(self) -> np.ndarray:
        """As of a path, shape (n_d, n - 1, n_u, 6), by the interval where each first acts."""
        return unfolded(self.pieces, self.lanes, self.groups, self.piece, self.since, len(self))

    @cached_property
    def samples(self) -> np.ndarray:
        """At the samples, shape (n_d, n, n_u), in the same order."""
        return at_samples(self.coefficients, self.t)

    @cached_property
    def first(self) -> np.ndarray:
        """At the first sample, shape (n_d, n_u), in the same order."""
        result, powers = np.zeros((len(self), self.pieces.shape[1])), np.arange(DEGREE + 1)
        for g in np.flatnonzero(self.groups[:, 0] == 0):
            at, columns = self.piece[g, 0], slice(self.groups[g, 2], self.groups[g, 2] + self.groups[g, 3])
            acting, value = self.lanes[at] >= 0, self.since[g, 0] ** powers @ self.pieces[at, columns]
            result[self.lanes[at, acting], columns] = value.T[acting]
        return result

    def scaled(self, factors: np.ndarray) -> Directions:
        """The same with each input multiplied by a factor, shape (n_u,)."""
        return replace(self, pieces=self.pieces * factors[:, None, None])

    def late(self, shifts: Mapping[int, float]) -> Directions:
        """Of splines some of whose inputs act late, input -> s; straight lines beyond the first and the last sample.

        A knot that comes between two samples acts from the nearer one on, where the path follows it in between: the
        spline's fifth derivative jumps there. So does an end, from where lines go on: there one sample differs.
        """
        n, inputs = len(self.t) - 1, self.pieces.shape[1]
        own, ends = np.array([shifts.get(column, 0.0) for column in range(inputs)]), self.t[[0, -1]]
        pieces, lanes, groups, piece, since = [self.pieces], [self.lanes], [], [], []
        for shift in dict.fromkeys(own.tolist()):
            times = self.t[:-1] - shift
            middle = times + np.diff(self.t) / 2
            k = np.clip(np.searchsorted(self.t, middle, side="right") - 1, 0, n - 1)
            for g, (_, _, first, count) in enumerate(self.groups):
                acting = first + np.flatnonzero(own[first : first + count] == shift)
                if not len(acting):
                    continue
                at, begun = self.piece[g, k], self.since[g, k] + times - self.t[k]
                for end, outside in zip((0, -1), (middle < ends[0], middle > ends[1]), strict=True):
                    if outside.any():
                        nearest = self.piece[g, end]
                        line = _tangent(self.pieces[nearest], self.since[g, end] + ends[end] - self.t[:-1][end])
                        at[outside], begun[outside] = sum(len(made) for made in pieces), times[outside] - ends[end]
                        pieces.append(line[None])
                        lanes.append(self.lanes[[nearest]])
                for beside in np.split(acting, 1 + np.flatnonzero(np.diff(acting) > 1)):
                    groups.append([0, n - 1, beside[0], len(beside)])
                    piece.append(at)
                    since.append(begun)
        support = np.clip(self.support, 0, n - 1)
        begins, after = self.t[support[:, 0]] + min(own.min(), 0.0), self.t[support[:, 1] + 1] + max(own.max(), 0.0)
        support = np.stack([np.searchsorted(self.t, begins) - 2, np.searchsorted(self.t, after) + 1], axis=1)
        made = np.concatenate(pieces), np.concatenate(lanes), np.array(groups, np.int64).reshape(-1, 4)
        support = np.ascontiguousarray(np.clip(support, 0, n - 1))  # wider costs little
        return Directions(self.names, self.t, *made, np.array(piece), np.array(since), support, self.order)

    def beside(self, others: Directions) -> Directions:
        """These after the others, by name."""
        support = np.concatenate([others.support, self.support])
        place = np.argsort(support[:, 0], kind="stable")
        order, shift = np.argsort(place), len(others)
        lanes = np.concatenate([others.lanes, np.where(self.lanes < 0, -1, self.lanes + shift)])
        return Directions(
            (*others.names, *self.names),
            self.t,
            np.concatenate([others.pieces, self.pieces]),
            np.where(lanes < 0, -1, np.append(order, 0)[lanes]),
            np.concatenate([others.groups, self.groups]),
            np.concatenate([others.piece, self.piece + len(others.pieces)]),
            np.concatenate([others.since, self.since]),
            support[place],
            order[np.concatenate([others.order, self.order + shift])],
        )


def _tangent(pieces: np.ndarray, x: float) -> np.ndarray:
    """Straight lines, about x, that touch polynomials there, shape (..., 6, LANES)."""
    powers, line = np.arange(DEGREE + 1), np.zeros_like(pieces)
    line[..., 0, :] = np.tensordot(pieces, x**powers, (-2, 0))
    line[..., 1, :] = np.tensordot(pieces[..., 1:, :], powers[1:] * x ** powers[:-1], (-2, 0))
    return line


def _support(coefficients: np.ndarray) -> np.ndarray:
    """First and last interval in which each direction acts, shape (n_d, 2)."""
    acts, count = (coefficients != 0).any(axis=(2, 3)), coefficients.shape[1]
    first = np.where(acts.any(axis=1), acts.argmax(axis=1), count)
    last = np.where(acts.any(axis=1), count - 1 - acts[:, ::-1].argmax(axis=1), -1)
    return np.stack([first, last], axis=1).astype(np.int64)
