"""A lifecycle node that refuses a transition which its state does not have."""

from collections.abc import Callable
from typing import Any

from forcecal_ros.nodes.runtime import RCLError
from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode


class ManagedNode(LifecycleNode):
    """A LifecycleNode; in rclpy's own, such a request ends the process with RCLError."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        for service in self.services:
            if service.srv_type is ChangeState:
                service.callback = _refusing(service.callback)


def _refusing(change: Callable[..., Any]) -> Callable[..., Any]:
    def on_request(request: ChangeState.Request, response: ChangeState.Response
                   ) -> ChangeState.Response:
        try:
            change(request, response)
        except RCLError:
            response.success = False
        return response

    return on_request
