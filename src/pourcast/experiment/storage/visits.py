"""What is noted of visits: who was refused, and which browsers took turns with one session.

The functions work in a transaction that `storage.Storage` opens.
"""

import sqlalchemy as sa

from pourcast.experiment.design.links import UNFILLED
from pourcast.experiment.storage.schema import BROWSERS, REFUSALS, SESSIONS
from pourcast.experiment.storage.sessions import OPEN, Session

REFUSED_BECAUSE = {
    UNFILLED: "as nobody had filled in the link; check the link that you gave away",
    "unlisted": "as the id is not in your list",
}
"""Refusals that a researcher must know of, and what they mean."""

AT_IT = 60.0
"""Who was heard of so long ago is still at it: a step takes seconds [s]."""


def note_browser(connection: sa.Connection, session: Session, request: str, now: float) -> None:
    """Note that a browser goes on with a session that another one is at.

    Somebody who changes computers needs longer: they may be two people with one id.
    """
    if session.state != OPEN or now - session.last_seen >= AT_IT:
        return
    known = sa.union(
        sa.select(SESSIONS.c.request).where(SESSIONS.c.id == session.number),
        sa.select(BROWSERS.c.request).where(BROWSERS.c.session == session.number),
    )
    if request not in set(connection.scalars(known)):
        connection.execute(BROWSERS.insert().values(session=session.number, request=request))


def all_browsers(connection: sa.Connection) -> list[tuple[int, str]]:
    """Sessions and the further browsers that took turns with them."""
    return [(row.session, row.request) for row in connection.execute(sa.select(BROWSERS))]


def browsers_at_once(connection: sa.Connection) -> dict[int, int]:
    """How many browsers took turns with a session, by its number; only where there were several."""
    counted = sa.select(BROWSERS.c.session, sa.func.count()).group_by(BROWSERS.c.session)
    return {session: 1 + others for session, others in connection.execute(counted)}


def count_refusal(connection: sa.Connection, reason: str) -> None:
    """Count a visit that was refused."""
    again = (
        REFUSALS.update().where(REFUSALS.c.reason == reason).values(visits=REFUSALS.c.visits + 1)
    )
    if not connection.execute(again).rowcount:
        connection.execute(REFUSALS.insert().values(reason=reason, visits=1))


def refusals(connection: sa.Connection) -> dict[str, int]:
    """How many visits were refused, by reason."""
    rows = connection.execute(sa.select(REFUSALS)).all()
    return {row.reason: row.visits for row in rows}
