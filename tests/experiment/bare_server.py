"""The least that can keep an answer: a request is read, committed to SQLite, and acknowledged.

The yardstick of `tests/experiment/test_load.py`: ``python -m tests.experiment.bare_server FILE``
prints the port that it listens on.
"""

import asyncio
import json
import sqlite3
import sys

_ANSWER = json.dumps({"saved": "new", "token": "", "steps": []}).encode()
_HEAD = b"HTTP/1.1 201 Created\r\nContent-Length: %d\r\n\r\n"


async def main(path: str) -> None:
    database = sqlite3.connect(path)
    database.executescript(
        "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; CREATE TABLE records (body BLOB);"
    )

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while not reader.at_eof():
            try:
                head = await reader.readuntil(b"\r\n\r\n")
            except asyncio.IncompleteReadError:
                break
            body = await reader.readexactly(
                int(head.lower().split(b"content-length:")[1].split()[0])
            )
            with database:
                database.execute("INSERT INTO records VALUES (?)", (body,))
            writer.write(_HEAD % len(_ANSWER) + _ANSWER)
            await writer.drain()
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    print(server.sockets[0].getsockname()[1], flush=True)
    await server.serve_forever()


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1]))
