/** Each transport keeps the contract of `transport.ts`, whoever keeps the records behind it. */
import * as fc from "fast-check";
import { describe, expect, it, vi } from "vitest";

import type { Entry } from "../src/outbox";
import { isPassing, Unreachable } from "../src/network";
import { makeTransport } from "../src/transports";
import { JatosTransport } from "../src/transports/jatos";
import { farewellOf, missingOf, openingOf, sessionOf } from "../src/transports/planned";
import { fileOf, FORMAT, lineOf } from "../src/transports/records";
import { ServerTransport } from "../src/transports/server";
import { StaticTransport } from "../src/transports/static";
import { Refused, type Transport } from "../src/transports/transport";
import type { Session, Step } from "../src/types";
import { JatosHost, OurServer, planOf, STEPS, WebHost, type Network } from "./hosts";

interface Made {
  network: Network;
  /** The transport of a page that has just been loaded. */
  page: () => Transport;
}

const LINK = { participant: "p1" };

const MEMBERS: { [name: string]: () => Made } = {
  server: () => ({ network: new OurServer().install(), page: () => new ServerTransport(LINK) }),
  jatos: () => {
    const network = new JatosHost().install();
    return { network, page: () => (network.load(), new JatosTransport(LINK)) };
  },
  static: () => ({ network: new WebHost().install(), page: () => new StaticTransport(LINK) }),
};

function entriesOf(token: string, numbers: number[]): Entry[] {
  return numbers.map((seq) => ({ session: token, seq, body: { x: seq }, saved: true }));
}

const ALL = STEPS.map(({ seq }) => seq);

/** Saves all that is asked for; returns the entries, as the outbox would hold them. */
async function saveAll(transport: Transport, token: string, numbers = ALL): Promise<Entry[]> {
  const entries = entriesOf(token, numbers);
  for (const { seq, body } of entries) await transport.save(token, seq, body, "tab");
  return entries;
}

async function refusal(asked: Promise<unknown>): Promise<Refused> {
  const error: unknown = await asked.then(() => null, (reason: unknown) => reason);
  expect(error).toBeInstanceOf(Refused);
  return error as Refused;
}

async function failure(asked: Promise<unknown>): Promise<Unreachable> {
  const error: unknown = await asked.then(() => null, (reason: unknown) => reason);
  expect(error).toBeInstanceOf(Unreachable);
  return error as Unreachable;
}

describe.each(Object.keys(MEMBERS))("the contract of transports: %s", (name) => {
  const make = MEMBERS[name] as () => Made;

  it("begins a session that is open, with steps of which none is done", async () => {
    const session = await make().page().begin("request-1", "tab");
    expect(session.token).not.toBe("");
    expect(session.code).not.toBe("");
    expect(session.state).toBe("open");
    expect(new Set(session.steps.map(({ seq }) => seq))).toEqual(new Set(ALL));
    expect(session.done).toEqual([]);
  });

  it("has one session for one request, however often it is posted", async () => {
    const { page } = make();
    // Places are drawn: eight draws would hardly be the same by chance.
    const sessions = [];
    for (let k = 0; k < 8; k++) sessions.push(await page().begin("request-1", "tab"));
    const [first, ...others] = sessions;
    for (const other of others) expect(other).toEqual(first);
  });

  it("goes on with a session after a reload", async () => {
    const { page } = make();
    const begun = await page().begin("request-1", "tab");
    const resumed = await page().resume(begun.token, "another tab");
    expect(resumed).toEqual(begun);
  });

  it("refuses a session that nobody knows as gone, before and after another has begun", async () => {
    const { page } = make();
    expect((await refusal(page().resume("unknown", "tab"))).reason).toBe("gone");
    await page().begin("request-1", "tab");
    expect((await refusal(page().resume("unknown", "tab"))).reason).toBe("gone");
  });

  it("saves a record, and the same one once more", async () => {
    const transport = make().page();
    const { token } = await transport.begin("request-1", "tab");
    expect(await transport.save(token, 0, { x: 1 }, "tab")).toMatchObject({ superseded: false });
    expect(await transport.save(token, 0, { x: 1 }, "tab")).toMatchObject({ superseded: false });
  });

  it("ends a session that is complete, with code and way back", async () => {
    const transport = make().page();
    const { token } = await transport.begin("request-1", "tab");
    const entries = await saveAll(transport, token);
    const ended = await transport.finish(token, "complete", entries, "tab");
    expect(ended).toEqual({ missing: [], code: "DONE1", redirect: "https://app.example.org/?cc=DONE1" });
  });

  it("names what is missing, and ends when it is there", async () => {
    const transport = make().page();
    const { token } = await transport.begin("request-1", "tab");
    const entries = await saveAll(transport, token, [1]);
    const said = await transport.finish(token, "complete", entries, "tab");
    expect(new Set(said.missing)).toEqual(new Set([0, 2]));
    expect(said.code).toBeUndefined();
    entries.push(...(await saveAll(transport, token, [0, 2])));
    expect(await transport.finish(token, "complete", entries, "tab")).toMatchObject({ missing: [], code: "DONE1" });
  });

  it("ends a session of somebody who declined, without a code", async () => {
    const transport = make().page();
    const { token } = await transport.begin("request-1", "tab");
    expect(await transport.finish(token, "declined", [], "tab")).toEqual({ missing: [], code: "", redirect: "" });
  });

  it("opens the file that a participant downloads", async () => {
    const transport = make().page();
    const session = await transport.begin("request-1", "tab");
    const opening = { format: "pourcast-records", schema_version: 1, session: session.key };
    expect(transport.opening(session)).toMatchObject(opening);
  });

  it("has stimuli beside the page", () => {
    expect(make().page().mediaUrl("a.png")).toBe("media/a.png");
  });

  it.each([
    ["unreachable", "offline"],
    [500, "failing"],
    [502, "failing"],
    [503, "failing"],
    [408, "failing"],
    [429, "failing"],
    ["nonsense", "failing"],
  ] as const)("takes %s for a fault that passes: whoever asks again gets the session", async (fault, why) => {
    const { network, page } = make();
    network.failures = [fault];
    const transport = page();
    expect((await failure(transport.begin("request-1", "tab"))).why).toBe(why);
    const { token } = await transport.begin("request-1", "tab");
    await saveAll(transport, token);
    network.failures = [fault];
    const resumed = page();
    expect((await failure(resumed.resume(token, "tab"))).why).toBe(why);
    expect((await resumed.resume(token, "tab")).token).toBe(token);
  });

  it("gives up who keeps silent, and asks anew", async () => {
    const { network, page } = make();
    vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout"] });
    network.failures = ["silent"];
    const transport = page();
    const asked = failure(transport.begin("request-1", "tab"));
    await vi.advanceTimersByTimeAsync(60_000);
    expect((await asked).why).toBe("silent");
    const begun = transport.begin("request-1", "tab");
    await vi.advanceTimersByTimeAsync(1000);
    expect((await begun).state).toBe("open");
  });

  it("works in browsers without AbortSignal.timeout", async () => {
    vi.spyOn(AbortSignal, "timeout").mockImplementation(() => {
      throw new TypeError("AbortSignal.timeout is not a function");
    });
    const transport = make().page();
    const { token } = await transport.begin("request-1", "tab");
    const entries = await saveAll(transport, token);
    expect(await transport.finish(token, "complete", entries, "tab")).toMatchObject({ code: "DONE1" });
  });

  it("does not take a defect for the network", async () => {
    const transport = make().page();
    vi.stubGlobal("AbortController", undefined);
    const error: unknown = await transport.begin("request-1", "tab").catch((reason: unknown) => reason);
    expect(error).toBeInstanceOf(Error);
    expect(error).not.toBeInstanceOf(Unreachable);
  });

  it("says in the file whose answers these are, and of what kind each is", async () => {
    const transport = make().page();
    const session = await transport.begin("request-1", "tab");
    const file = fileOf(transport.opening(session), session.steps, entriesOf(session.token, ALL));
    const [opening, ...records] = JSON.parse(file) as { [key: string]: unknown }[];
    expect(opening).toEqual({ ...transport.opening(session) });
    const kinds = new Map(session.steps.map((step) => [step.seq, step.kind]));
    for (const record of records) {
      expect(record).toMatchObject({ session: session.key, trial_type: "pourcast" });
      expect(record["kind"]).toBe(kinds.get(record["seq"] as number));
    }
    expect(records).toHaveLength(3);
  });
});

describe("the folder of transports", () => {
  it("has none that the contract is not tested on", () => {
    const modules = import.meta.glob<{ [name: string]: unknown }>("../src/transports/*.ts", { eager: true });
    const kinds = Object.values(modules)
      .flatMap((module) => Object.values(module))
      .filter((one) => typeof one === "function" && "begin" in ((one.prototype ?? {}) as object));
    new JatosHost().install();
    const tested = Object.values(MEMBERS).map((make) => make().page().constructor);
    expect(new Set(tested)).toEqual(new Set(kinds));
    expect(kinds.length).toBeGreaterThan(2);
  });
});

describe("our server", () => {
  it("is told who asks, and by which tab", async () => {
    const network = new OurServer().install();
    const transport = new ServerTransport(LINK);
    const { token } = await transport.begin("request-1", "tab-1");
    await transport.save(token, 1, { response: 0.5 }, "tab-1");
    await transport.resume(token, "tab-2");
    await transport.finish(token, "screened_out", [], "tab-2");
    const asked = network.requests.map(({ method, url, content }) => ({ method, url, content }));
    expect(asked).toEqual([
      { method: "POST", url: "api/sessions", content: { request: "request-1", tab: "tab-1", link: LINK } },
      { method: "PUT", url: "api/session/records/1", content: { tab: "tab-1", body: { response: 0.5 } } },
      { method: "POST", url: "api/session/resume", content: { tab: "tab-2" } },
      { method: "POST", url: "api/session/finish", content: { state: "screened_out", tab: "tab-2" } },
    ]);
    const authorized = network.requests.map(({ headers }) => headers.get("Authorization"));
    expect(authorized).toEqual([null, ...Array<string>(3).fill(`Bearer ${token}`)]);
  });

  it("tells a tab that another one has the session", async () => {
    new OurServer().install();
    const transport = new ServerTransport(LINK);
    const { token } = await transport.begin("request-1", "tab-1");
    await transport.resume(token, "tab-2");
    expect(await transport.save(token, 0, {}, "tab-1")).toMatchObject({ superseded: true });
    expect(await transport.save(token, 1, {}, "tab-2")).toMatchObject({ superseded: false });
    await transport.resume(token); // Only looks.
    expect(await transport.save(token, 2, {}, "tab-2")).toMatchObject({ superseded: false });
  });

  it("has the record once when its answer is lost", async () => {
    const network = new OurServer().install();
    const transport = new ServerTransport(LINK);
    const { token } = await transport.begin("request-1", "tab");
    network.failures = ["no answer"];
    await expect(transport.save(token, 0, { x: 1 }, "tab")).rejects.toThrow("Failed to fetch");
    await transport.save(token, 0, { x: 1 }, "tab");
    expect([...(network.sessions.get(token)?.kept ?? [])]).toEqual([[0, { x: 1 }]]);
  });

  it.each([
    [403, { refused: "full", text: "All places are taken." }, "full", "All places are taken."],
    [429, { refused: "busy", text: "Too many." }, "busy", "Too many."],
    [401, { refused: "gone", text: "Gone." }, "gone", "Gone."],
    [404, { error: "no such step" }, "broken", ""],
    [422, { error: "body: field required" }, "broken", ""],
    [413, "at most 65536 bytes", "broken", ""],
  ])("refuses with %i for good, and says why", async (status, content, reason, text) => {
    vi.stubGlobal("fetch", async () => new Response(JSON.stringify(content), { status }));
    const refused = await refusal(new ServerTransport(LINK).begin("request-1", "tab"));
    expect(refused).toMatchObject({ reason, status, text });
  });
});

describe("JATOS", () => {
  const parsed = (results: string) =>
    results.trim().split("\n").map((line) => JSON.parse(line) as { [key: string]: unknown });

  /** The record lines, as they have to be found by whoever has no opening. */
  const expected = (transport: JatosTransport, session: Session, entries: Entry[]) =>
    entries.map(({ seq, body }) => {
      const { session: name, group, place } = transport.opening(session);
      const { kind } = session.steps.find((step) => step.seq === seq) as Step;
      return { session: name, seq, kind, group, place, body, trial_type: "pourcast" };
    });

  it("gets a line that opens the session, then each record as it comes", async () => {
    const network = new JatosHost().install();
    const transport = new JatosTransport(LINK);
    const session = await transport.begin("request-1");
    expect(network.results).toBe(""); // Whoever declines leaves nothing.
    const entries = await saveAll(transport, session.token);
    const [opening, ...records] = parsed(network.results);
    expect(opening).toEqual(transport.opening(session));
    expect(opening).toMatchObject({ entry: "jatos", identifiers: { participant: "p1", PROLIFIC_PID: "p7" } });
    expect(records).toEqual(expected(transport, session, entries));
    await transport.finish(session.token, "complete", entries);
    expect(network.ended).toBe(true);
  });

  it("goes on with a run even where the browser remembers nothing", async () => {
    const network = new JatosHost().install();
    const { token } = await new JatosTransport(LINK).begin("request-1");
    network.load();
    localStorage.clear();
    const again = await new JatosTransport(LINK).begin("another request");
    expect(again.token).toBe(token);
  });

  it("keeps a run's session, though its mark was lost on the way", async () => {
    const network = new JatosHost().install();
    network.fates = ["offline"];
    const transport = new JatosTransport(LINK);
    await failure(transport.begin("request-1"));
    const { token } = await transport.begin("request-1");
    network.load();
    expect((await new JatosTransport(LINK).begin("another request")).token).toBe(token);
  });

  it("has the line that opens the session after any failure, and before any record", async () => {
    const fates = fc.array(fc.constantFrom(undefined, "offline", "answer lost", 500, "reload"), { maxLength: 12 });
    await fc.assert(
      fc.asyncProperty(fates, async (fate) => {
        const network = new JatosHost().install();
        localStorage.clear();
        let transport = new JatosTransport(LINK);
        const session = await transport.begin("request-1");
        const entries = entriesOf(session.token, ALL);
        const waiting = [...fate];
        const afterFailures: string[] = [];
        for (const { seq, body } of entries) {
          for (let saved = false; !saved; ) {
            const next = waiting.shift();
            if (next === "reload") {
              transport = (network.load(), new JatosTransport(LINK));
              await transport.resume(session.token);
              continue;
            }
            network.fates = [next as undefined];
            saved = await transport.save(session.token, seq, body).then(
              () => true,
              () => false,
            );
            if (saved) continue;
            const { length } = network.results;
            await transport.save(session.token, seq, body);
            afterFailures.push(network.results.slice(length));
            saved = true;
          }
        }
        // It stands before what comes after a failure, too, where nobody knows what was lost.
        for (const lines of afterFailures) expect(parsed(lines)[0]).toEqual(transport.opening(session));
        const found = parsed(network.results);
        expect(found[0]).toEqual(transport.opening(session));
        const openings = found.filter((line) => "format" in line);
        for (const opening of openings) expect(opening).toEqual(transport.opening(session));
        const records = found.filter((line) => !("format" in line));
        for (const one of expected(transport, session, entries)) expect(records).toContainEqual(one);
      }),
    );
  });

  it("is sent what an earlier run left in the browser, under that run's name", async () => {
    const network = new JatosHost().install();
    const before = new JatosTransport(LINK);
    const session = await before.begin("request-1");
    const other = new JatosHost().install();
    const transport = new JatosTransport(LINK);
    expect((await transport.begin("request-2")).token).not.toBe(session.token);
    await transport.save(session.token, 0, { x: 0 });
    expect(network.results).toBe("");
    expect(parsed(other.results)).toEqual([
      before.opening(session),
      ...expected(before, session, entriesOf(session.token, [0])),
    ]);
  });

  it.each([
    ["offline", "offline"],
    ["silent", "silent"],
    ["answer lost", "silent"],
    [500, "failing"],
  ] as const)("may take a record after all when it was %s", async (fate, why) => {
    const network = new JatosHost().install();
    const transport = new JatosTransport(LINK);
    const { token } = await transport.begin("request-1");
    network.fates = [fate];
    vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout"] });
    const asked = failure(transport.save(token, 0, {}));
    await vi.advanceTimersByTimeAsync(120_000);
    expect((await asked).why).toBe(why);
  });

  it.each([400, 403, 413] as const)("refuses a record with %i for good: the session does not end as complete", async (fate) => {
    const network = new JatosHost().install();
    const transport = new JatosTransport(LINK);
    const { token } = await transport.begin("request-1");
    network.fates = [fate];
    expect((await refusal(transport.save(token, 0, {}))).status).toBe(fate);
    const entries = entriesOf(token, ALL);
    for (const entry of entries) entry.saved = entry.seq > 0;
    expect(await transport.finish(token, "complete", entries)).toEqual({ missing: [0] });
    expect(network.ended).toBeNull();
  });

  it("ends for the participant, too, when jatos.js could not say so the only time it does", async () => {
    const network = new JatosHost().install();
    const transport = new JatosTransport(LINK);
    const { token } = await transport.begin("request-1");
    const entries = await saveAll(transport, token);
    network.fates = ["offline"];
    await failure(transport.finish(token, "complete", entries));
    expect(await transport.finish(token, "complete", entries)).toMatchObject({ code: "DONE1" });
  });

  it("is told of a session that did not succeed, too", async () => {
    const network = new JatosHost().install();
    const transport = new JatosTransport(LINK);
    const { token } = await transport.begin("request-1");
    await transport.finish(token, "failed_check", []);
    expect(network.ended).toBe(false);
  });

  it("isn't told of the end while something is missing", async () => {
    const network = new JatosHost().install();
    const transport = new JatosTransport(LINK);
    const { token } = await transport.begin("request-1");
    await transport.finish(token, "complete", []);
    expect(network.ended).toBeNull();
  });
});

describe("a static folder", () => {
  it("sends all records at the end, as one file", async () => {
    const network = new WebHost().install();
    const transport = new StaticTransport(LINK);
    const session = await transport.begin("request-1");
    const { token } = session;
    const opening = transport.opening(session);
    const entries = entriesOf(token, ALL);
    await transport.finish(token, "complete", entries);
    expect([...network.files]).toEqual([[`${token}.json`, fileOf(opening, session.steps, entries)]]);
    expect(network.requests.at(-1)?.content["experimentID"]).toBe("ABC123");
  });

  it("sends what there is when a session ends early, and nothing of somebody who declined", async () => {
    const network = new WebHost().install();
    const transport = new StaticTransport(LINK);
    const { token } = await transport.begin("request-1");
    await transport.finish(token, "screened_out", entriesOf(token, [0]));
    expect(network.files.size).toBe(1);
    const other = await transport.begin("request-2");
    await transport.finish(other.token, "declined", entriesOf(other.token, [0]));
    expect(network.files.size).toBe(1);
  });

  it("sends nothing while something is missing", async () => {
    const network = new WebHost().install();
    const transport = new StaticTransport(LINK);
    const { token } = await transport.begin("request-1");
    await transport.finish(token, "complete", entriesOf(token, [0]));
    expect(network.files.size).toBe(0);
  });

  it("has the file once when DataPipe's answer is lost", async () => {
    const network = new WebHost().install();
    const transport = new StaticTransport(LINK);
    const { token } = await transport.begin("request-1");
    network.failures = ["no answer"];
    const entries = entriesOf(token, ALL);
    await failure(transport.finish(token, "complete", entries));
    expect(await transport.finish(token, "complete", entries)).toMatchObject({ code: "DONE1" });
    expect(network.files.size).toBe(1);
  });

  it("has done its part when DataPipe has the file, and puts it in its place later", async () => {
    const network = new WebHost().install();
    network.datapipe.storage = "queued";
    const transport = new StaticTransport(LINK);
    const { token } = await transport.begin("request-1");
    expect(await transport.finish(token, "complete", entriesOf(token, ALL))).toMatchObject({ code: "DONE1" });
  });

  it("asks again while the storage behind DataPipe is away", async () => {
    const network = new WebHost().install();
    network.datapipe.storage = "away";
    const transport = new StaticTransport(LINK);
    const { token } = await transport.begin("request-1");
    const entries = entriesOf(token, ALL);
    expect((await failure(transport.finish(token, "complete", entries))).why).toBe("failing");
    network.datapipe.storage = "there";
    expect(await transport.finish(token, "complete", entries)).toMatchObject({ code: "DONE1" });
  });

  it.each([
    [{ active: false }, "not switched on"],
    [{ finalized: true }, "not switched on"],
    [{ experiments: [] }, "study not known"],
    [{ limit: 0 }, "no more people"],
    [{ required: ["another"] }, "another form"],
    [{ json: false, csv: true }, "another form"],
    [{ owner: false }, "no place"],
    [{ storage: "not connected" as const }, "no place"],
    [{ largest: 10 }, "too large"],
  ])("says why DataPipe takes nothing when it is set to %j, and ends once it is set right", async (wrong, words) => {
    const network = new WebHost().install();
    const right = { ...network.datapipe };
    Object.assign(network.datapipe, wrong);
    const { token } = await new StaticTransport(LINK).begin("request-1");
    const entries = entriesOf(token, ALL);
    const refused = await refusal(new StaticTransport(LINK).finish(token, "complete", entries));
    expect(refused.text).toBe(words);
    // The page is loaded again after the researcher has seen to it.
    network.datapipe = right;
    expect(await new StaticTransport(LINK).finish(token, "complete", entries)).toMatchObject({ code: "DONE1" });
  });

  it("leaves nobody's identifiers in the browser: neither of who declined, nor of who is done", async () => {
    new WebHost().install();
    const stored = () => JSON.stringify(Object.entries(localStorage));
    for (const end of ["declined", "complete"] as const) {
      const transport = new StaticTransport({ PROLIFIC_PID: "p9" });
      const { token } = await transport.begin(`request-${end}`);
      expect(stored()).toContain("p9");
      await transport.finish(token, end, entriesOf(token, ALL));
      expect(stored()).not.toContain("p9");
    }
  });

  it("says what DataPipe said where that is new", async () => {
    new WebHost().install();
    const transport = new StaticTransport(LINK);
    const { token } = await transport.begin("request-1");
    await transport.resume(token);
    vi.stubGlobal("fetch", async () => new Response(JSON.stringify({ error: "OF_TOMORROW" }), { status: 400 }));
    const refused = await refusal(transport.finish(token, "complete", entriesOf(token, ALL)));
    expect(refused.text).toBe("answered 400 OF_TOMORROW");
  });

  it("is over when it is loaded again after its end, and begins nothing", async () => {
    new WebHost().install();
    const { token } = await new StaticTransport(LINK).begin("request-1");
    await new StaticTransport(LINK).finish(token, "complete", entriesOf(token, ALL));
    expect(await new StaticTransport(LINK).resume(token)).toMatchObject({
      state: "complete",
      code: "DONE1",
      redirect: "https://app.example.org/?cc=DONE1",
    });
  });

  it.each([429, 500, 503])("asks DataPipe again after %i", async (status) => {
    const network = new WebHost().install();
    const transport = new StaticTransport(LINK);
    const { token } = await transport.begin("request-1");
    const entries = entriesOf(token, ALL);
    network.failures = [status];
    const error: unknown = await transport.finish(token, "complete", entries).catch((reason: unknown) => reason);
    expect(error).not.toBeInstanceOf(Refused);
    expect(await transport.finish(token, "complete", entries)).toMatchObject({ code: "DONE1" });
  });

  it("offers a file where there is no DataPipe, after a reload, too", async () => {
    new WebHost(planOf({ datapipe: "" })).install();
    const alone = new StaticTransport(LINK);
    const session = await alone.begin("request-2");
    expect((await refusal(alone.finish(session.token, "complete", entriesOf(session.token, ALL)))).reason).toBe("file");
    expect(alone.opening(session)).toEqual(new StaticTransport(LINK).opening(session));
  });

  it("isn't there without its plan, and says so at once", async () => {
    vi.stubGlobal("fetch", async () => new Response("Not Found", { status: 404 }));
    const refused = await refusal(new StaticTransport(LINK).begin("request-1"));
    expect(refused.reason).toBe("plan.json: status 404");
  });

  it("begins anew when its place is in the plan no more", async () => {
    const network = new WebHost().install();
    const { token } = await new StaticTransport(LINK).begin("request-1");
    network.plan = planOf({ places: [{ group: 7, place: 7, steps: STEPS }] });
    expect(await refusal(new StaticTransport(LINK).resume(token))).toMatchObject({
      reason: "gone",
      text: "It is gone.",
    });
  });
});

describe("a plan", () => {
  it("gives each place its turn", () => {
    const plan = planOf();
    const drawn = new Set(
      Array.from({ length: 100 }, () => {
        const { group, place } = openingOf(plan, "static", {}, "s");
        return `${group} ${place}`;
      }),
    );
    expect(drawn).toEqual(new Set(["0 0", "1 0", "1 1"]));
  });

  it("has the steps of the place that was drawn", () => {
    const plan = planOf();
    const opening = { ...openingOf(plan, "static", {}, "s"), group: 1, place: 0 };
    expect(sessionOf(plan, opening).steps).toEqual(STEPS.toReversed());
  });

  it("has a code to each end, one's own where none is set", () => {
    const plan = planOf();
    expect(farewellOf(plan, "complete", "OWN").code).toBe("DONE1");
    expect(farewellOf(plan, "screened_out", "OWN").code).toBe("OUT1");
    expect(farewellOf(plan, "failed_check", "OWN")).toEqual({ code: "", redirect: "" });
    expect(farewellOf(plan, "declined", "OWN")).toEqual({ code: "", redirect: "" });
    const bare = planOf({ codes: { complete: "", screened_out: "", failed_check: "" } });
    // As our server does.
    expect(farewellOf(bare, "complete", "OWN")).toEqual({
      code: "OWN",
      redirect: "https://app.example.org/?cc=OWN",
    });
    expect(farewellOf(bare, "screened_out", "OWN")).toEqual({ code: "", redirect: "" });
  });

  it("leads back with whatever code is set", () => {
    fc.assert(
      fc.property(fc.string({ minLength: 1 }), (code) => {
        const plan = planOf({ codes: { complete: code, screened_out: "", failed_check: "" } });
        expect(farewellOf(plan, "complete", "").redirect).toBe(`https://app.example.org/?cc=${code}`);
      }),
    );
    const plan = planOf({ codes: { complete: "A$&B", screened_out: "", failed_check: "" } });
    expect(farewellOf(plan, "complete", "").redirect).toBe("https://app.example.org/?cc=A$&B");
  });

  it("is written as a file that can be read back, whole or line by line, whatever was answered", () => {
    const marks = fc.string({ unit: fc.constantFrom("a", '"', "\n", "\u0085", "\u2028", "\u2029", "\ud800") });
    fc.assert(
      fc.property(fc.array(fc.dictionary(marks, fc.oneof(fc.jsonValue(), marks))), (bodies) => {
        const entries = bodies.map((body, seq) => ({ session: "s", seq, body, saved: false }));
        const opening = { ...FORMAT, session: "s", group: 1, place: 2 };
        const text = fileOf(opening, STEPS, entries);
        const bare = (body: object) => JSON.parse(JSON.stringify(body)) as object;
        const expected = bodies.map((body, seq) => {
          const kind = STEPS[seq]?.kind;
          const record = { session: "s", seq, kind, group: 1, place: 2, body: bare(body), trial_type: "pourcast" };
          return bare(record);
        });
        expect(JSON.parse(text)).toEqual([opening, ...expected]);
        const split = text.split(/[\n\u0085\u2028\u2029]/).slice(1, -2);
        expect(split.map((line) => JSON.parse(line.replace(/,$/, "")) as object)).toEqual([opening, ...expected]);
      }),
    );
    expect(lineOf({ remark: "a\u2028b" })).toBe('{"remark":"a\\u2028b"}');
  });

  it("misses just the steps without a record", () => {
    fc.assert(
      fc.property(fc.subarray(ALL), (there) => {
        const plan = planOf();
        const opening = { ...openingOf(plan, "static", {}, "s"), group: 0, place: 0 };
        const missing = missingOf(sessionOf(plan, opening), entriesOf("s", there));
        expect(missing).toEqual(ALL.filter((seq) => !there.includes(seq)));
      }),
    );
  });
});

describe("a page", () => {
  it.each([
    ["server", ServerTransport],
    ["static", StaticTransport],
    ["jatos", JatosTransport],
  ])("that was made for %s has its transport", (name, kind) => {
    new JatosHost().install();
    document.head.innerHTML = `<meta name="pourcast-transport" content="${name}">`;
    expect(makeTransport({})).toBeInstanceOf(kind);
    document.head.innerHTML = "";
    expect(makeTransport({})).toBeInstanceOf(ServerTransport);
  });

  it("waits for a status that passes, and for no other", () => {
    expect([408, 429, 500, 502, 503, 504].every(isPassing)).toBe(true);
    expect([400, 401, 403, 404, 409, 410, 413, 422].some(isPassing)).toBe(false);
  });
});
