"""The tables of an experiment's database."""

import sqlalchemy as sa

SCHEMA = 3
"""Version of these tables; `migrations` brings older ones to it."""

TABLES = sa.MetaData()
META = sa.Table(
    "meta",
    TABLES,
    sa.Column("name", sa.Text, primary_key=True),
    sa.Column("value", sa.Text, nullable=False),
)
SESSIONS = sa.Table(
    "sessions",
    TABLES,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("key", sa.Text, nullable=False, unique=True),
    sa.Column("request", sa.Text, nullable=False, unique=True),
    sa.Column("participant", sa.Text, nullable=False, index=True),
    sa.Column("entry", sa.Text, nullable=False),
    sa.Column("identifiers", sa.Text, nullable=False),
    sa.Column("group_number", sa.Integer, nullable=False),
    sa.Column("place", sa.Integer, nullable=False),
    sa.Column("state", sa.Text, nullable=False),
    sa.Column("tab", sa.Text, nullable=False),
    sa.Column("code", sa.Text, nullable=False),
    sa.Column("plan", sa.Text, nullable=False),
    sa.Column("started", sa.Float, nullable=False),
    sa.Column("last_seen", sa.Float, nullable=False),
    # The number of a session that was deleted never becomes another's.
    sqlite_autoincrement=True,
)
TOKENS = sa.Table(
    "tokens",
    TABLES,
    sa.Column("digest", sa.Text, primary_key=True),
    sa.Column("session", sa.ForeignKey("sessions.id"), nullable=False, index=True),
)
RECORDS = sa.Table(
    "records",
    TABLES,
    sa.Column("session", sa.ForeignKey("sessions.id"), primary_key=True),
    sa.Column("seq", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("kind", sa.Text, nullable=False),
    sa.Column("body", sa.Text, nullable=False),
    sa.Column("received", sa.Float, nullable=False),
)
CONFLICTS = sa.Table(
    "aside",
    TABLES,
    sa.Column("session", sa.ForeignKey("sessions.id"), primary_key=True),
    sa.Column("seq", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("digest", sa.Text, primary_key=True),
    sa.Column("body", sa.Text, nullable=False),
    sa.Column("received", sa.Float, nullable=False),
)
BROWSERS = sa.Table(
    "browsers",
    TABLES,
    # Beside the one that began the session: those that went on with it while another was at it.
    sa.Column("session", sa.ForeignKey("sessions.id"), primary_key=True),
    sa.Column("request", sa.Text, primary_key=True),
)
REFUSALS = sa.Table(
    "refusals",
    TABLES,
    sa.Column("reason", sa.Text, primary_key=True),
    sa.Column("visits", sa.Integer, nullable=False),
)
