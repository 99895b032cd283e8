"""The observer as a managed node: every transition from every state, over its services."""

from forcecal_ros.io.calibration_file import save
from lifecycle_msgs.msg import Transition
from live import Live
from observing import calibration
import pytest

UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = 'unconfigured', 'inactive', 'active', 'finalized'
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


@pytest.fixture
def start(ros_domain, tmp_path):
    """Return a function that starts an observer and returns a bench for it."""
    save(calibration(), tmp_path / 'calibration.yaml')
    with Live() as live:
        def started(module='forcecal_ros.nodes.observer', executor='events'):
            live.run(module, 'observer', [
                '-p', 'autostart:=false', '-p', 'publish.innovation:=true',
                '-p', 'publish.frames:=[base]', '-p', f'executor:={executor}',
                '-p', f'calibration.file:={tmp_path / "calibration.yaml"}'])
            return live

        yield started


def refuses_all_but_what_leads_on(live, state):
    assert live.state() == state
    for transition in {CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE, *SHUTDOWN.values()}:
        if (state, transition) not in ALLOWED:
            assert not live.ask_for(transition)
    assert live.state() == state


@pytest.mark.parametrize('executor, last', [
    ('events', UNCONFIGURED), ('single', INACTIVE), ('events', ACTIVE)])
def test_a_transition_leads_where_the_state_machine_says_or_is_refused(start, executor, last):
    live, state = start(executor=executor), UNCONFIGURED
    # all the way and back, a second time, and on until the last
    for transition in (CONFIGURE, ACTIVATE, DEACTIVATE, ACTIVATE, DEACTIVATE, CLEANUP) * 2 + (
            PATHS[last]):
        refuses_all_but_what_leads_on(live, state)
        assert live.ask_for(transition)
        state = ALLOWED[state, transition]
    refuses_all_but_what_leads_on(live, last)
    assert live.ask_for(SHUTDOWN[last])
    refuses_all_but_what_leads_on(live, FINALIZED)


def test_an_error_of_a_transition_leads_back_to_where_all_can_begin_anew(start):
    live = start('defective_observer')
    assert live.ask_for(CONFIGURE)
    assert not live.ask_for(ACTIVATE)
    assert live.state() == UNCONFIGURED
    for frame in ('', '/base'):
        assert not live.node.get_publishers_info_by_topic(f'observer/contact_wrench{frame}')
    for step in (CONFIGURE, ACTIVATE, DEACTIVATE, CLEANUP):
        assert live.ask_for(step)
    assert live.ask_for(SHUTDOWN[UNCONFIGURED])
