import geometry_msgs.msg
import std_msgs.msg

class Path:
    header: std_msgs.msg.Header
    poses: list[geometry_msgs.msg.PoseStamped]
    def __init__(self, *, header: std_msgs.msg.Header = ..., poses: list[geometry_msgs.msg.PoseStamped] = ...) -> None: ...
