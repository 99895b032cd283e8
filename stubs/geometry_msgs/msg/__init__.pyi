import std_msgs.msg

class Accel:
    linear: Vector3
    angular: Vector3
    def __init__(self, *, linear: Vector3 = ..., angular: Vector3 = ...) -> None: ...

class AccelStamped:
    header: std_msgs.msg.Header
    accel: Accel
    def __init__(self, *, header: std_msgs.msg.Header = ..., accel: Accel = ...) -> None: ...

class Inertia:
    m: float
    com: Vector3
    ixx: float
    ixy: float
    ixz: float
    iyy: float
    iyz: float
    izz: float
    def __init__(self, *, m: float = ..., com: Vector3 = ..., ixx: float = ..., ixy: float = ..., ixz: float = ..., iyy: float = ..., iyz: float = ..., izz: float = ...) -> None: ...

class InertiaStamped:
    header: std_msgs.msg.Header
    inertia: Inertia
    def __init__(self, *, header: std_msgs.msg.Header = ..., inertia: Inertia = ...) -> None: ...

class Point:
    x: float
    y: float
    z: float
    def __init__(self, *, x: float = ..., y: float = ..., z: float = ...) -> None: ...

class Pose:
    position: Point
    orientation: Quaternion
    def __init__(self, *, position: Point = ..., orientation: Quaternion = ...) -> None: ...

class PoseStamped:
    header: std_msgs.msg.Header
    pose: Pose
    def __init__(self, *, header: std_msgs.msg.Header = ..., pose: Pose = ...) -> None: ...

class Quaternion:
    x: float
    y: float
    z: float
    w: float
    def __init__(self, *, x: float = ..., y: float = ..., z: float = ..., w: float = ...) -> None: ...

class Transform:
    translation: Vector3
    rotation: Quaternion
    def __init__(self, *, translation: Vector3 = ..., rotation: Quaternion = ...) -> None: ...

class TransformStamped:
    header: std_msgs.msg.Header
    child_frame_id: str
    transform: Transform
    def __init__(self, *, header: std_msgs.msg.Header = ..., child_frame_id: str = ..., transform: Transform = ...) -> None: ...

class Twist:
    linear: Vector3
    angular: Vector3
    def __init__(self, *, linear: Vector3 = ..., angular: Vector3 = ...) -> None: ...

class TwistStamped:
    header: std_msgs.msg.Header
    twist: Twist
    def __init__(self, *, header: std_msgs.msg.Header = ..., twist: Twist = ...) -> None: ...

class Vector3:
    x: float
    y: float
    z: float
    def __init__(self, *, x: float = ..., y: float = ..., z: float = ...) -> None: ...

class Vector3Stamped:
    header: std_msgs.msg.Header
    vector: Vector3
    def __init__(self, *, header: std_msgs.msg.Header = ..., vector: Vector3 = ...) -> None: ...

class Wrench:
    force: Vector3
    torque: Vector3
    def __init__(self, *, force: Vector3 = ..., torque: Vector3 = ...) -> None: ...

class WrenchStamped:
    header: std_msgs.msg.Header
    wrench: Wrench
    def __init__(self, *, header: std_msgs.msg.Header = ..., wrench: Wrench = ...) -> None: ...
