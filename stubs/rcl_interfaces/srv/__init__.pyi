from typing import ClassVar
import rcl_interfaces.msg

class DescribeParameters:
    class Request:
        names: list[str]
        def __init__(self, *, names: list[str] = ...) -> None: ...
    class Response:
        descriptors: list[rcl_interfaces.msg.ParameterDescriptor]
        def __init__(self, *, descriptors: list[rcl_interfaces.msg.ParameterDescriptor] = ...) -> None: ...

class ListParameters:
    class Request:
        DEPTH_RECURSIVE: ClassVar[int]
        prefixes: list[str]
        depth: int
        def __init__(self, *, prefixes: list[str] = ..., depth: int = ...) -> None: ...
    class Response:
        result: rcl_interfaces.msg.ListParametersResult
        def __init__(self, *, result: rcl_interfaces.msg.ListParametersResult = ...) -> None: ...

class SetParameters:
    class Request:
        parameters: list[rcl_interfaces.msg.Parameter]
        def __init__(self, *, parameters: list[rcl_interfaces.msg.Parameter] = ...) -> None: ...
    class Response:
        results: list[rcl_interfaces.msg.SetParametersResult]
        def __init__(self, *, results: list[rcl_interfaces.msg.SetParametersResult] = ...) -> None: ...
