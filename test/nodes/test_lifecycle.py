"""The observer as a managed node: every transition from every state, over its services."""

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

PATHS = {UNCONFIGURED: (), INACTIVE: (CONFIGURE,), ACTIVE: (CONFIGURE, ACTIVATE),
         FINALIZED: (SHUTDOWN[UNCONFIGURED],)}
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


@pytest.fixture(params=[EventsExecutor, SingleThreadedExecutor])
def manager(ros_domain, tmp_path, request):
    yield from managed(Observer, request.param, tmp_path)


@pytest.fixture
def defective(ros_domain, tmp_path):
    yield from managed(Defective, EventsExecutor, tmp_path)


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


@pytest.mark.parametrize('transition', [CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE,
                                        *SHUTDOWN.values()])
@pytest.mark.parametrize('state', list(PATHS))
def test_a_transition_leads_where_the_state_machine_says_or_is_refused(manager, state, transition):
    for step in PATHS[state]:
        assert manager.ask_for(step)
    assert manager.state == state
    assert manager.ask_for(transition) == ((state, transition) in ALLOWED)
    assert manager.state == ALLOWED.get((state, transition), state)


def test_a_node_that_was_cleaned_up_goes_all_the_way_again(manager):
    for _ in range(2):
        for step in (CONFIGURE, ACTIVATE, DEACTIVATE, ACTIVATE, DEACTIVATE, CLEANUP):
            assert manager.ask_for(step)
    assert manager.state == UNCONFIGURED
    assert manager.ask_for(SHUTDOWN[UNCONFIGURED])
    assert manager.state == FINALIZED


def test_an_error_of_a_transition_leads_back_to_where_all_can_begin_anew(defective):
    assert defective.ask_for(CONFIGURE)
    assert not defective.ask_for(ACTIVATE)
    assert defective.state == UNCONFIGURED
    assert defective.topics == 0
    for step in (CONFIGURE, ACTIVATE, DEACTIVATE, CLEANUP):
        assert defective.ask_for(step)
    assert defective.ask_for(SHUTDOWN[UNCONFIGURED])
