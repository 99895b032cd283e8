"""Trigger services that answer with one sentence."""

from collections.abc import Callable

from forcecal_ros.errors import ForcecalError
from std_srvs.srv import Trigger


def answering(act: Callable[[], str], refused: Callable[[str], None] | None = None
              ) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
    """
    Make the callback of a Trigger service of a function that returns a sentence, or raises.

    Parameters
    ----------
    refused : callable, optional
        Called with the sentence of a :class:`ForcecalError`.
    """
    def on_request(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.message, response.success = act(), True
        except ForcecalError as error:
            response.message, response.success = str(error), False
            if refused is not None:
                refused(str(error))
        return response

    return on_request
