"""
What the tool of a MuJoCo model touches: how soft that is, how it rubs, and where it stands.

MuJoCo mixes both of a contact's geoms, or takes the larger or harder one. So what is changed of
the one that is touched is changed of the tool's own geoms by the same ratio: then the ratio is the
contact's, however they are mixed.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from forcecal_ros.core.geometry import Array
from forcecal_ros.sim.protocol import Parameter
import numpy as np
from numpy.typing import NDArray

SOFT, RUBBING = 0.05, 0.1
"""
Of a contact's time constant and of its friction, 1 sigma, relative: a stiffness, which goes with
one over the square of that time, is taken to be known as well as a friction, to a tenth.
"""

FAR = 5.0
"""Factor by which either may be off, at most: beyond, another material was meant."""

STANDS, MOVED = 0.001, 0.1
"""
Of the place of what stands in the world, 1 sigma and at most [m]: as a table is measured. Were it
taken to be where the model has it, one that is a millimetre lower would be called softer.
"""

FACES = 0.1
"""Part of a contact's normal along an axis, from which a place along that axis counts."""

SOLREF, FRICTION, PLACE = 'geom_solref', 'geom_friction', 'geom_pos'

AXES = 'xyz'

_Write = Callable[[Any, float], None]


def touchable(model: Any, body: str) -> dict[int, str]:
    """Name the geoms, by their place in the model, that a body or what hangs on it may touch."""
    own, found = own_geoms(model, body), {}
    for i in range(model.ngeom):
        with_any = ((model.geom_contype[i] & model.geom_conaffinity[own])
                    | (model.geom_contype[own] & model.geom_conaffinity[i]))
        if i not in own and with_any.any():
            found[i] = _name(model, i)
    return found


def own_geoms(model: Any, body: str) -> NDArray[np.intp]:
    """List the geoms of a body and of all that hangs on it."""
    tool = int(model.body(body).id)
    return np.array([i for i in range(model.ngeom)
                     if tool in _carrying(model, int(model.geom_bodyid[i]))], dtype=np.intp)


def _carrying(model: Any, body: int) -> Iterator[int]:
    while body:
        yield body
        body = int(model.body_parentid[body])


def _name(model: Any, i: int) -> str:
    body = int(model.geom_bodyid[i])
    return model.geom(i).name or (f'{model.body(body).name or f"body {body}"}.'
                                  f'{i - int(model.body_geomadr[body])}')


def contact_numbers(model: Any, body: str) -> Iterator[tuple[Parameter, _Write, _Write]]:
    """
    List softness, friction and, where it stands in the world, place of all that a tool may touch.

    Yields
    ------
    Parameter, write, patch
        Into a model that was compiled, and into its source, which was compiled, too.
    """
    own, names = own_geoms(model, body), touchable(model, body)
    for field, part in ((SOLREF, SOFT), (FRICTION, RUBBING)):
        shared = _Shared(model, field, own)
        for i, name in names.items():
            value = float(shared.first[i])
            slides = max(model.geom_condim[i], model.geom_condim[own].max()) > 1
            if value == 0.0 or (field == FRICTION and not slides):
                continue
            stiffness = field == SOLREF and value < 0.0
            low, high = sorted((value / FAR, value * FAR))
            unit = '1' if field == FRICTION else '1/s^2' if stiffness else 's'
            yield (Parameter(f'{field}[{name}]', value, (1 + stiffness) * part * abs(value), unit,
                             low, high, 'environment'), *shared.of(i))
    for i, name in names.items():
        if model.body_weldid[model.geom_bodyid[i]] == 0:
            yield from _places(model, i, name)


def _places(model: Any, i: int, name: str) -> Iterator[tuple[Parameter, _Write, _Write]]:
    first = model.geom_pos[i].copy()

    def along(axis: int) -> tuple[_Write, _Write]:
        def write(to: Any, value: float) -> None:
            to.geom_pos[i, axis] = value

        def patch(spec: Any, value: float) -> None:
            geom = {one.id: one for one in spec.geoms}[i]
            for place in (geom.pos[axis:], geom.fromto[axis:], geom.fromto[axis + 3:]):
                place[0] += value - first[axis]
        return write, patch

    for k, a in enumerate(AXES):
        yield (Parameter(f'{PLACE}[{name}].{a}', float(first[k]), STANDS, 'm', first[k] - MOVED,
                         first[k] + MOVED, 'environment'), *along(k))


class _Shared:
    """The first number of a field of geoms, which one ratio changes of two that touch."""

    def __init__(self, model: Any, field: str, own: NDArray[np.intp]) -> None:
        self._field, self._own, self._ratio = field, own, dict[int, float]()
        self.first = getattr(model, field)[:, 0].copy()

    def of(self, geom: int) -> tuple[_Write, _Write]:
        """Return what writes that of a geom, and the tool's along."""
        def write(model: Any, value: float) -> None:
            rows = getattr(model, self._field)
            for i, number in self._changed(geom, value).items():
                rows[i, 0] = number

        def patch(spec: Any, value: float) -> None:
            geoms = {one.id: one for one in spec.geoms}
            for i, number in self._changed(geom, value).items():
                getattr(geoms[i], self._field.removeprefix('geom_'))[0] = number
        return write, patch

    def _changed(self, geom: int, value: float) -> Mapping[int, float]:
        self._ratio[geom] = value / self.first[geom]
        whole = float(np.prod(list(self._ratio.values())))
        return {geom: value, **{int(i): float(self.first[i] * whole) for i in self._own}}


class Touched:
    """Collects what a tool touches while a model is run."""

    def __init__(self, model: Any, body: str) -> None:
        self._model, self._own = model, own_geoms(model, body)
        self._names = touchable(model, body)
        self._faces: dict[int, Array] = {}

    @property
    def parameters(self) -> set[str]:
        """Names of the parameters of what was touched."""
        found = {f'{field}[{self._names[i]}]' for field in (SOLREF, FRICTION) for i in self._faces}
        return found | {f'{PLACE}[{self._names[i]}].{a}' for i, faces in self._faces.items()
                        for a, most in zip(AXES, faces) if most > FACES}

    def look(self, data: Any) -> None:
        """See what touches now, and along which axes of the body that has it."""
        for k in range(data.ncon):
            pair, normal = data.contact.geom[k], data.contact.frame[k, :3]
            for i in {int(one) for one in pair} & self._names.keys():
                if data.contact.exclude[k] == 0 and np.isin(pair, self._own).any():
                    body = data.xmat[self._model.geom_bodyid[i]].reshape(3, 3)
                    self._faces[i] = np.maximum(self._faces.get(i, np.zeros(3)),
                                                np.abs(normal @ body))
