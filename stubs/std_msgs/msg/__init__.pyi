from array import array
from collections.abc import Sequence
import builtin_interfaces.msg

class ColorRGBA:
    r: float
    g: float
    b: float
    a: float
    def __init__(self, *, r: float = ..., g: float = ..., b: float = ..., a: float = ...) -> None: ...

class Float64MultiArray:
    layout: MultiArrayLayout
    @property
    def data(self) -> array[float]: ...
    @data.setter
    def data(self, value: Sequence[float]) -> None: ...
    def __init__(self, *, layout: MultiArrayLayout = ..., data: Sequence[float] = ...) -> None: ...

class Header:
    stamp: builtin_interfaces.msg.Time
    frame_id: str
    def __init__(self, *, stamp: builtin_interfaces.msg.Time = ..., frame_id: str = ...) -> None: ...

class MultiArrayDimension:
    label: str
    size: int
    stride: int
    def __init__(self, *, label: str = ..., size: int = ..., stride: int = ...) -> None: ...

class MultiArrayLayout:
    dim: list[MultiArrayDimension]
    data_offset: int
    def __init__(self, *, dim: list[MultiArrayDimension] = ..., data_offset: int = ...) -> None: ...

class String:
    data: str
    def __init__(self, *, data: str = ...) -> None: ...
