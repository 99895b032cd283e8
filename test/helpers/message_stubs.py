"""
Type stubs of the ROS messages that this project imports: ``stubs/``, made from their classes.

ROS generates message modules without types. Run this file after importing another message type.
"""

import ast
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
import re
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
STUBS = ROOT / 'stubs'
SEARCHED = ('benchmark', 'forcecal_ros', 'launch', 'test')
INTERFACES = re.compile(r'(?!launch|tf2_msgs)\w+\.(msg|srv)')
IMPORTS = re.compile(r'^ *from \w+\.(msg|srv) import', re.MULTILINE)
SEQUENCE = re.compile(r'sequence<([\w/]+)(?:, \d+)?>')
ARRAY = re.compile(r'([\w/]+)\[\d+\]')
SCALARS = {'boolean': 'bool', 'double': 'float', 'float': 'float', 'octet': 'bytes',
           'string': 'str', **{f'{sign}int{bits}': 'int' for sign in ('', 'u')
                               for bits in (8, 16, 32, 64)}}
NUMBERS = {'int', 'float'}

Interface = tuple[str, str]
"""Module and name, as ``('std_srvs.srv', 'Trigger')``."""


def _imported() -> set[Interface]:
    """Every message and service type that a source file imports."""
    found = set()
    for folder in SEARCHED:
        for path in (ROOT / folder).rglob('*.py'):
            text = path.read_text()
            for node in ast.walk(ast.parse(text)) if IMPORTS.search(text) else ():
                if isinstance(node, ast.ImportFrom) and INTERFACES.fullmatch(node.module or ''):
                    found |= {(str(node.module), alias.name) for alias in node.names}
    return found


def _classes(interface: Interface) -> list[tuple[str, Any]]:
    """Return the class of a message; of a service those of request and response."""
    module, name = interface
    found = getattr(import_module(module), name)
    if module.endswith('.srv'):
        return [('Request', found.Request), ('Response', found.Response)]
    return [(name, found)]


def _parts(interface: Interface) -> Iterator[Interface]:
    """Yield the message types among the fields."""
    for _, message in _classes(interface):
        for kind in message.get_fields_and_field_types().values():
            for package, name in re.findall(r'(\w+)/(\w+)', kind):
                yield f'{package}.msg', name


def _closure(wanted: set[Interface]) -> set[Interface]:
    known: set[Interface] = set()
    while wanted:
        known |= wanted
        wanted = {part for interface in wanted for part in _parts(interface)} - known
    return known


def _types(kind: str, module: str) -> tuple[str, str]:
    """Return what reading a field gives, and what it takes when it is set."""
    if match := SEQUENCE.fullmatch(kind):
        item = _types(match[1], module)[0]
        if item in NUMBERS:
            return f'array[{item}]', f'Sequence[{item}]'
        return f'list[{item}]', f'list[{item}]'
    if match := ARRAY.fullmatch(kind):
        return 'NDArray[Any]', f'Sequence[{SCALARS[match[1]]}] | NDArray[Any]'
    if kind in SCALARS:
        return SCALARS[kind], SCALARS[kind]
    package, name = kind.split('/')
    full = name if module == f'{package}.msg' else f'{package}.msg.{name}'
    return full, full


def _body(message: Any, module: str, indent: str) -> str:
    fields = {name: _types(kind, module)
              for name, kind in message.get_fields_and_field_types().items()}
    constants = {name: value for name, value in type(message).__prepare__('', ()).items()
                 if not name.endswith('__DEFAULT')}
    lines = [f'{name}: ClassVar[{type(value).__name__}]' for name, value in constants.items()]
    for name, (read, taken) in fields.items():
        if read == taken:
            lines.append(f'{name}: {read}')
            continue
        lines += ['@property', f'def {name}(self) -> {read}: ...', f'@{name}.setter',
                  f'def {name}(self, value: {taken}) -> None: ...']
    arguments = ''.join(f', {name}: {taken} = ...' for name, (_, taken) in fields.items())
    if fields:
        lines.append(f'def __init__(self, *{arguments}) -> None: ...')
    return ''.join(f'{indent}{line}\n' for line in lines or ['...'])


def _text(interface: Interface) -> str:
    module, name = interface
    if module.endswith('.msg'):
        (_, message), = _classes(interface)
        return f'class {name}:\n{_body(message, module, "    ")}'
    return f'class {name}:\n' + ''.join(
        f'    class {part}:\n{_body(message, module, "        ")}'
        for part, message in _classes(interface))


HEAD = (('array[', 'from array import array'),
        ('Sequence[', 'from collections.abc import Sequence'),
        ('Any]', 'from typing import Any'), ('ClassVar[', 'from typing import ClassVar'),
        ('NDArray[', 'from numpy.typing import NDArray'))
"""What a stub imports where it says that."""


def make() -> dict[str, str]:
    """Return the text of each stub by its path in ``stubs``."""
    modules: dict[str, list[Interface]] = {}
    for interface in sorted(_closure(_imported())):
        modules.setdefault(interface[0], []).append(interface)
    stubs = {}
    for module, interfaces in modules.items():
        text = '\n'.join(map(_text, interfaces))
        head = [line for word, line in HEAD if word in text]
        head += [f'import {other}' for other in sorted(set(re.findall(r'\b\w+\.msg(?=\.)', text)))]
        package, kind = module.split('.')
        stubs[f'{package}/__init__.pyi'] = ''
        stubs[f'{package}/{kind}/__init__.pyi'] = '\n'.join(head) + '\n' * 2 * bool(head) + text
    return stubs


if __name__ == '__main__':
    for name, text in make().items():
        (STUBS / name).parent.mkdir(parents=True, exist_ok=True)
        (STUBS / name).write_text(text)
