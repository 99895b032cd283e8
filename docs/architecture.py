"""Draw the rooms of the package and who imports whom: ``python docs/architecture.py``.

The picture is made of the imports alone. A room lies above all that it imports, an arrow that
follows from two others is left out, and so are the tools, which every room may use.
"""

import ast
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.util import resolve_name
from itertools import pairwise
from pathlib import Path

PACKAGE = 'forcecal_ros'
SOURCE = Path(__file__).resolve().parents[1] / PACKAGE
PICTURE = Path(__file__).with_suffix('.svg')

TOOLS = ('core',)
"""What every package imports."""

WITHIN = ('io.bags',)
"""Parts of a room that are shown apart from it."""

PART_OF = {'entry': 'cli', 'results': 'api'}
"""Modules next to the packages that belong to one: ``entry`` loads others by name."""

HOLDS = {
    'api': 'the same\nfrom Python',
    'calibrate': 'tool, sensors and noise\n[Gamez2005]',
    'checks': 'what a recording\ncan have wrong',
    'cli': 'the command line:\none module a command',
    'diagnose': 'where and why simulation\nand recording differ',
    'effects': 'ways in which a rig\ndiffers from its model',
    'impedance': 'plant and law\n[Gamez2005] V',
    'insitu': 'six-axis matrix\n[Traversaro2014]',
    'io': 'CSV, URDF, calibration\nfile, exports',
    'io.bags': 'the only readers\nof bags',
    'motion': 'plans, limits, monitor,\nsequence',
    'nodes': 'ROS 2: thin, the only\nusers of rclpy',
    'observe': 'contact wrench: one\nstep, many filters',
    'report': 'tables, pictures, pages;\nmany robots over time',
    'rig_fit': "a rig of a\nuser's robot",
    'sim': 'the rig; shares no\nphysics with calibrate',
}
"""What each room is for, in the words of the picture."""

Graph = Mapping[str, frozenset[str]]


def module_name(path: Path) -> str:
    """Return the dotted name of a file of the package."""
    parts = path.relative_to(SOURCE.parent).with_suffix('').parts
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


PATHS = {module_name(path): path for path in sorted(SOURCE.rglob('*.py'))}


@cache
def tree(name: str) -> ast.Module:
    """Return the source of a module, parsed."""
    return ast.parse(PATHS[name].read_text())


@cache
def imported_by(name: str) -> frozenset[str]:
    """Return every module that is named in an import of this one, wherever in its text."""
    found = set()
    package = name if PATHS[name].name == '__init__.py' else name.rpartition('.')[0]
    for node in ast.walk(tree(name)):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = resolve_name('.' * node.level + (node.module or ''), package)
            for alias in node.names:
                submodule = f'{base}.{alias.name}'
                found.add(submodule if submodule in PATHS else base)
    return frozenset(found)


def room(name: str) -> str:
    """Return the room of a module: its file or folder at the top, '' for the package itself."""
    parts = name.split('.')[1:3]
    top = ''.join(parts[:1])
    return '.'.join(parts) if '.'.join(parts) in WITHIN else PART_OF.get(top, top)


def rooms() -> Graph:
    """Return which rooms each room imports, tools left out."""
    graph: dict[str, set[str]] = {}
    for name in PATHS:
        graph.setdefault(room(name), set()).update(
            room(target) for target in imported_by(name) if target in PATHS)
    left_out = {'', *TOOLS}
    return {one: frozenset(targets - left_out - {one}) for one, targets in sorted(graph.items())
            if one not in left_out}


def reduced(graph: Graph) -> Graph:
    """Leave out what follows from the rest: the arrow to a room that another one leads to."""
    def reached(one: str) -> set[str]:
        return set(graph[one]).union(*map(reached, graph[one]))

    return {one: frozenset(target for target in targets
                           if not any(target in reached(other) for other in targets))
            for one, targets in graph.items()}


def levels(graph: Graph) -> dict[str, int]:
    """Return how far above the ground each room lies: one above the highest that it imports."""
    found: dict[str, int] = {}

    def level(one: str) -> int:
        if one not in found:
            found[one] = 1 + max((level(target) for target in graph[one]), default=-1)
        return found[one]

    return {one: level(one) for one in graph}


def ids(graph: Graph) -> set[str]:
    """Return the ids that the picture gives to its rooms and arrows."""
    return {f'room-{one}' for one in graph} | {
        f'{one}-imports-{target}' for one, targets in graph.items() for target in targets}


Point = tuple[str, int]
"""A room, or where an arrow passes a level: its name and level."""


def ways(graph: Graph) -> list[list[Point]]:
    """Return what each arrow passes, from top to ground, one point a level."""
    level = levels(graph)
    return [[(one, level[one]),
             *((f'{one} {target}', k) for k in range(level[one] - 1, level[target], -1)),
             (target, level[target])]
            for one, targets in graph.items() for target in sorted(targets)]


def placed(graph: Graph, width: float = 1.0, narrow: float = 0.22) -> dict[Point, float]:
    """Return where each point lies across: neighbours near each other, arrows beside the rooms."""
    lines: dict[int, list[Point]] = {}
    near: dict[Point, list[Point]] = {}
    for one, k in levels(graph).items():
        lines.setdefault(k, []).append((one, k))
    for way in ways(graph):
        for point in way[1:-1]:
            lines.setdefault(point[1], []).append(point)
        for above, below in pairwise(way):
            near.setdefault(above, []).append(below)
            near.setdefault(below, []).append(above)
    across = {point: float(i) for line in lines.values() for i, point in enumerate(line)}
    for sweep in range(60):
        order = sorted(lines, reverse=bool(sweep % 2))
        for k in order:
            towards = -1 if sweep % 2 == 0 else 1

            def wanted(point: Point, towards: int = towards, k: int = k) -> float:
                there = [across[other] for other in near.get(point, ()) if other[1] == k + towards]
                return sum(there) / len(there) if there else across[point]

            _spread(sorted(lines[k], key=wanted), across, graph, width, narrow)
    return across


def _spread(line: Iterable[Point], across: dict[Point, float], graph: Graph, width: float,
            narrow: float) -> None:
    """Put the points of one level side by side about the middle."""
    points = list(line)
    sizes = [width if point[0] in graph else narrow for point in points]
    at = -sum(sizes) / 2.0
    for point, size in zip(points, sizes):
        across[point], at = at + size / 2.0, at + size


ROS, EDGE, NUMERICS = '#fbe3d6', '#e2f0e6', '#e3ecf7'
KINDS = {ROS: 'knows ROS', EDGE: 'reads recordings, draws, talks to the user',
         NUMERICS: 'numerics: no ROS, no printing'}
"""Colours of the rooms."""


def colour(name: str) -> str:
    """Return the colour of a room by what its modules import from elsewhere."""
    outside = {target.split('.')[0] for module in PATHS
               if room(module) == name for target in imported_by(module)}
    if 'rclpy' in outside:
        return ROS
    return EDGE if outside & {'argparse', 'matplotlib', 'rosbags'} else NUMERICS


def draw(path: Path = PICTURE) -> None:
    """Write the picture."""
    import matplotlib
    from matplotlib.figure import Figure
    from matplotlib.patches import FancyBboxPatch, PathPatch
    from matplotlib.path import Path as Line

    matplotlib.rcParams.update({'svg.hashsalt': PACKAGE, 'svg.fonttype': 'none',
                                'font.family': 'DejaVu Sans'})
    graph = reduced(rooms())
    level, across = levels(graph), placed(graph)
    edge = max(abs(x) for x in across.values()) + 0.6
    figure = Figure(figsize=(4.3 * edge, 1.4 * (max(level.values()) + 2)))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(-edge, edge), ylim=(-1.2, max(level.values()) + 0.5))
    axes.set_axis_off()
    for way in ways(graph):
        corners = [(across[point], point[1]) for point in way]
        vertices, codes = [(corners[0][0], corners[0][1] - 0.28)], [Line.MOVETO]
        for (x0, y0), (x1, y1) in pairwise(corners):
            end = y1 + 0.28 if (x1, y1) == corners[-1] else y1
            middle = 0.5 * (y0 + y1)
            vertices += [(x0, middle), (x1, middle), (x1, end)]
            codes += [Line.CURVE4] * 3
        axes.add_patch(PathPatch(Line(vertices, codes), fill=False, color='#8a8a8a',
                                 linewidth=1.1, gid=f'{way[0][0]}-imports-{way[-1][0]}'))
        axes.annotate('', (corners[-1][0], corners[-1][1] + 0.27), (corners[-1][0],
                      corners[-1][1] + 0.34), arrowprops={'arrowstyle': '-|>', 'color': '#8a8a8a'})
    for one, k in level.items():
        x = across[one, k]
        axes.add_patch(FancyBboxPatch(
            (x - 0.44, k - 0.27), 0.88, 0.54, boxstyle='round,pad=0,rounding_size=0.05',
            facecolor=colour(one), edgecolor='#444444', gid=f'room-{one}'))
        axes.text(x, k + 0.15, one, ha='center', va='center', weight='bold', fontsize=13)
        axes.text(x, k - 0.08, HOLDS[one], ha='center', va='center', fontsize=10)
    axes.add_patch(FancyBboxPatch(
        (0.06 - edge, -0.95), 2.0 * edge - 0.12, 0.4, boxstyle='round,pad=0,rounding_size=0.05',
        facecolor='#f1f1f1', edgecolor='#444444'))
    axes.text(0.0, -0.75, f'tools that any room may use: {", ".join(TOOLS)}', ha='center',
              va='center', fontsize=11)
    for i, (kind, words) in enumerate(KINDS.items()):
        y = max(level.values()) + 0.3 - 0.22 * i
        axes.add_patch(FancyBboxPatch((0.1 - edge, y - 0.06), 0.12, 0.12, facecolor=kind,
                                      edgecolor='#444444', boxstyle='square,pad=0'))
        axes.text(0.28 - edge, y, words, va='center', fontsize=11)
    figure.savefig(path, metadata={'Date': None, 'Creator': None})


if __name__ == '__main__':
    draw()
