"""Steps of the bias are fitted once for each set of them that is left."""

from forcecal_ros.diagnose.search import bias_steps
from forcecal_ros.diagnose.search.bias_steps import Event


def test_a_step_that_is_none_costs_one_fit_more(monkeypatch):
    true, false = (Event(0, t, t, t, {0: 1.0}) for t in (2.0, 5.0))
    fits = []

    def with_events(model, events):
        fits.append([e.instant for e in events])
        return 'fitted'

    monkeypatch.setattr(bias_steps, '_as_seen', lambda model, events: model)
    monkeypatch.setattr(bias_steps, '_sharpened', lambda model, events: [
        e._replace(instant=round(e.instant) + 0.001) for e in events])
    monkeypatch.setattr(bias_steps, '_with_events', with_events)
    monkeypatch.setattr(bias_steps, '_agreeing', lambda model, events: [
        e for e in events if e.instant < 3.0])
    model, events = bias_steps._fitted('model', [true, false])
    assert model == 'fitted'
    assert [e.instant for e in events] == [2.001]
    assert fits == [[2.001, 5.001], [2.001]]
