import lifecycle_msgs.msg

class ChangeState:
    class Request:
        transition: lifecycle_msgs.msg.Transition
        def __init__(self, *, transition: lifecycle_msgs.msg.Transition = ...) -> None: ...
    class Response:
        success: bool
        def __init__(self, *, success: bool = ...) -> None: ...

class GetState:
    class Request:
        ...
    class Response:
        current_state: lifecycle_msgs.msg.State
        def __init__(self, *, current_state: lifecycle_msgs.msg.State = ...) -> None: ...
