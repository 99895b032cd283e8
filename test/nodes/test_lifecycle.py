"""The observer as a managed node: every transition from every state, over its services."""

from contextlib import contextmanager

from forcecal_ros.io.calibration_file import save
from forcecal_ros.nodes.observer import Observer
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from observing import calibration
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental import EventsExecutor

UNCONFIGURED, INACTIVE = State.PRIMARY_STATE_UNCONFIGURED, State.PRIMARY_STATE_INACTIVE
ACTIVE, FINALIZED = State.PRIMARY_STATE_ACTIVE, State.PRIMARY_STATE_FINALIZED
CONFIGURE, CLEANUP = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP
ACTIVATE, DEACTIVATE = Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE
SHUTDOWN = {UNCONFIGURED: Transition.TRANSITION_UNCONFIGURED_SHUTDOWN,
            INACTIVE: Transition.TRANSITION_INACTIVE_SHUTDOWN,
            ACTIVE: Transition.TRANSITION_ACTIVE_SHUTDOWN}

ALLOWED = {
    (UNCONFIGURED, CONFIGURE): INACTIVE,
    (INACTIVE, ACTIVATE): ACTIVE,
    (INACTIVE, CLEANUP): UNCONFIGURED,
    (ACTIVE, DEACTIVATE): INACTIVE,
    **dict.fromkeys(SHUTDOWN.items(), FINALIZED),
}
"""The state machine of managed nodes, https://design.ros2.org/articles/node_lifecycle.html."""

PATHS = {UNCONFIGURED: (), INACTIVE: (CONFIGURE,), ACTIVE: (CONFIGURE, ACTIVATE)}
"""How each state is reached by a node just made."""


class Manager:
    """An observer, and a lifecycle manager that talks to it."""

    def __init__(self, observer, executor):
        self._node = rclpy.create_node('manager')
        self._executor = executor
        for node in (observer, self._node):
            self._executor.add_node(node)
        self._clients = {kind: self._node.create_client(kind, f'observer/{name}')
                         for kind, name in ((ChangeState, 'change_state'),
                                            (GetState, 'get_state'))}

    def _call(self, request, kind):
        client = self._clients[kind]
        assert client.wait_for_service(timeout_sec=20)
        future = client.call_async(request)
        self._executor.spin_until_future_complete(future, timeout_sec=20)
        return future.result()

    def ask_for(self, transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        return self._call(request, ChangeState).success

    @property
    def state(self):
        return self._call(GetState.Request(), GetState).current_state.id

    @property
    def topics(self):
        """Number of publishers of the contact wrench, in whatever frame."""
        return sum(len(self._node.get_publishers_info_by_topic(f'observer/contact_wrench{frame}'))
                   for frame in ('', '/base'))

    def close(self):
        self._executor.shutdown()
        self._node.destroy_node()


class Defective(Observer):
    """Fails in the midst of its first activation, as only a mistake of ours can make it."""

    failed = False

    def on_activate(self, state):
        if not self.failed:
            self.failed = True
            raise RuntimeError('a mistake')
        return super().on_activate(state)


@contextmanager
def managed(kind, executor, tmp_path):
    save(calibration(), tmp_path / 'calibration.yaml')
    rclpy.init(args=['--ros-args', '-p', 'autostart:=false', '-p', 'publish.innovation:=true',
                     '-p', 'publish.frames:=[base]',
                     '-p', f'calibration.file:={tmp_path / "calibration.yaml"}'])
    try:
        observer = kind()
        manager = Manager(observer, executor())
        yield manager
        manager.close()
        observer.destroy_node()
    finally:
        rclpy.try_shutdown()


def refuses_all_but_what_leads_on(manager, state):
    assert manager.state == state
    for transition in {CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE, *SHUTDOWN.values()}:
        if (state, transition) not in ALLOWED:
            assert not manager.ask_for(transition)
    assert manager.state == state


@pytest.mark.parametrize('executor, last', [
    (EventsExecutor, UNCONFIGURED), (SingleThreadedExecutor, INACTIVE), (EventsExecutor, ACTIVE)])
def test_a_transition_leads_where_the_state_machine_says_or_is_refused(
        ros_domain, tmp_path, executor, last):
    with managed(Observer, executor, tmp_path) as manager:
        state = UNCONFIGURED
        # all the way and back, a second time, and on until the last
        for transition in (CONFIGURE, ACTIVATE, DEACTIVATE, ACTIVATE, DEACTIVATE, CLEANUP) * 2 + (
                PATHS[last]):
            refuses_all_but_what_leads_on(manager, state)
            assert manager.ask_for(transition)
            state = ALLOWED[state, transition]
        refuses_all_but_what_leads_on(manager, last)
        assert manager.ask_for(SHUTDOWN[last])
        refuses_all_but_what_leads_on(manager, FINALIZED)


def test_an_error_of_a_transition_leads_back_to_where_all_can_begin_anew(ros_domain, tmp_path):
    with managed(Defective, EventsExecutor, tmp_path) as manager:
        assert manager.ask_for(CONFIGURE)
        assert not manager.ask_for(ACTIVATE)
        assert manager.state == UNCONFIGURED
        assert manager.topics == 0
        for step in (CONFIGURE, ACTIVATE, DEACTIVATE, CLEANUP):
            assert manager.ask_for(step)
        assert manager.ask_for(SHUTDOWN[UNCONFIGURED])
