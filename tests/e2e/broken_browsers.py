"""Facilities that browsers lack, deny, or never answer from, taken away by scripts.

Old versions can't be had. What they lack is read from MDN's table of compatibility.
"""

import json
from pathlib import Path
from typing import Any

WEB = Path(__file__).parents[2] / "src/pourcast/experiment/page/web"
COMPATIBILITY = WEB / "tests/node_modules/@mdn/browser-compat-data/data.json"

_DENIED = 'throw new DOMException("The operation is insecure.", "SecurityError");'

NO_STORAGE = f"""
Object.defineProperty(window, "localStorage", {{ get() {{ {_DENIED} }} }});
"""

FULL_STORAGE = """
Storage.prototype.setItem = () => { throw new DOMException("full", "QuotaExceededError"); };
"""

DATABASE_NEVER_OPENS = """
const open = IDBFactory.prototype.open;
IDBFactory.prototype.open = function () {
  const request = open.call(this, "never");
  request.addEventListener = () => undefined;
  return request;
};
"""

DATABASE_NEVER_WRITES = """
for (const name of ["get", "add", "put", "delete"]) {
  const own = IDBObjectStore.prototype[name];
  IDBObjectStore.prototype[name] = function (...given) {
    const request = own.apply(this, given);
    request.addEventListener = () => undefined;
    return request;
  };
}
"""

COOKIES_BLOCKED = f"""
{NO_STORAGE}
Object.defineProperty(window, "sessionStorage", {{ get() {{ {_DENIED} }} }});
IDBFactory.prototype.open = () => {{ {_DENIED} }};
window.BroadcastChannel = function () {{ {_DENIED} }};
"""

NO_LIMITS = "delete AbortSignal.timeout;"

NOTHING_NEW = """
delete AbortSignal.timeout;
delete window.BroadcastChannel;
delete window.structuredClone;
delete window.indexedDB;
delete Object.hasOwn;
delete crypto.constructor.prototype.getRandomValues;
delete crypto.constructor.prototype.randomUUID;
"""


_PLAYWRIGHTS = ("BigInt64Array", "BigUint64Array")
"""What Playwright's own scripts in the page can't do without."""


def oldest(browser: str) -> str:
    """The oldest version of a browser that is served, as package.json has it; named as MDN does."""
    stated = json.loads((WEB / "package.json").read_text())["browserslist"]
    names = {"safari_ios": "ios_saf"}
    return str(dict(line.split(" >= ") for line in stated)[names.get(browser, browser)])


def without_what_is_newer(browser: str, version: str) -> str:
    """A script that takes away what a version of a browser does not have yet."""
    table = json.loads(COMPATIBILITY.read_text())
    found: list[list[str]] = []
    for group in (table["api"], table["javascript"]["builtins"]):
        for name, entry in group.items():
            if name in _PLAYWRIGHTS:
                continue
            if _is_newer(entry, browser, version):
                found.append([name])
            else:
                found += [
                    [name, member]
                    for member, inner in entry.items()
                    if member != "__compat" and _is_newer(inner, browser, version)
                ]
    return f"""
    for (const [name, member] of {json.dumps(found)}) {{
      const kind = window[name];
      if (!member) delete window[name];
      else if (member.endsWith("_static")) delete kind?.[member.replace("_static", "")];
      else if (name === "Window") delete window[member];
      else delete (kind?.prototype ?? kind)?.[member];
    }}
    """


def _is_newer(entry: dict[str, Any], browser: str, version: str) -> bool:
    support = entry.get("__compat", {}).get("support", {}).get(browser, {})
    first = support[-1] if isinstance(support, list) else support
    added = first.get("version_added", "0")
    if added is False:
        return True
    if first.get("flags") or first.get("prefix") or first.get("alternative_name"):
        return False
    return isinstance(added, str) and _number(added) > _number(version)


def _number(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.lstrip("≤").split(".") if part.isdigit())
