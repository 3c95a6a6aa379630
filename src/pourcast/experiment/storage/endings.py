"""How a participant's page ends a session, and what it can't end.

The functions work in a transaction that `storage.Storage` opens.
"""

from dataclasses import dataclass, replace

import sqlalchemy as sa

from pourcast.experiment.storage.records import saved_steps
from pourcast.experiment.storage.sessions import (
    COMPLETE,
    DECLINED,
    DECLINED_LATER,
    DROPPED,
    OPEN,
    Session,
    end_session,
    session_by_token,
)


@dataclass(frozen=True)
class Ending:
    """What became of a page's wish to end a session.

    Parameters
    ----------
    session
        The session; its state is that of now, whatever the page wished.
    missing
        Steps that a session lacks to be complete.
    is_new
        Whether it ended now, and not before.
    """

    session: Session
    missing: tuple[int, ...] = ()
    is_new: bool = False


def finish_session(connection: sa.Connection, token: str, state: str, tab: str) -> Ending | None:
    """End a session as a page wishes; None if there is none.

    Only an open session is ended, or a dropped one. It is complete when all its records are there,
    whichever tab says so; all else only the tab can say that has the session. Who declines after
    something was saved has agreed before: that is kept.
    """
    session = session_by_token(connection, token, for_update=True)
    if session is None:
        return None
    if session.state not in (OPEN, DROPPED):
        return Ending(session)
    saved = set(saved_steps(connection, session.number))
    if state == COMPLETE:
        missing = tuple(step.seq for step in session.steps if step.seq not in saved)
        if missing:
            return Ending(session, missing)
    elif tab != session.tab:
        return Ending(session)
    elif state == DECLINED and saved:
        state = DECLINED_LATER
    end_session(connection, session.number, state)
    return Ending(replace(session, state=state), is_new=True)
