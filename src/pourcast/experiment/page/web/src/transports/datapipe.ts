/** DataPipe (pipe.jspsych.org), which puts a file into the researcher's storage, at the OSF or elsewhere. */
import { askForJson, isPassing, Unreachable } from "../network";
import type { Texts } from "../texts";
import { Refused } from "./transport";

const ADDRESS = "https://pipe.jspsych.org/api/data/";

/** Somewhat longer than the service's own limit [ms]. */
const TIMEOUT = 70_000;

/** Its refusals, as https://github.com/jspsych/datapipe/blob/main/functions/src/api-messages.ts names them. */
const REFUSALS: { [code: string]: keyof Texts["collecting"] } = {
  DATA_COLLECTION_NOT_ACTIVE: "inactive",
  EXPERIMENT_FINALIZED: "inactive",
  EXPERIMENT_NOT_FOUND: "unknown",
  EXPERIMENT_DATA_NOT_FOUND: "unknown",
  SESSION_LIMIT_REACHED: "limit",
  INVALID_DATA: "invalid",
  METADATA_ERROR: "invalid",
  INVALID_OWNER: "storage",
  USER_DATA_NOT_FOUND: "storage",
  INVALID_OSF_TOKEN: "storage",
  INVALID_REFRESH_TOKEN: "storage",
  PROVIDER_NOT_CONNECTED: "storage",
  PROVIDER_TOKEN_EXPIRED: "storage",
};

/**
 * Sends a file whose name nobody else's has.
 *
 * Raises `Unreachable` where trying again helps, and `Refused`, with words for the participant, where
 * it doesn't.
 */
export async function sendToDataPipe(
  experimentID: string,
  filename: string,
  data: string,
  words: Texts["collecting"],
): Promise<void> {
  const init: RequestInit = {
    method: "POST",
    headers: { "Content-Type": "application/json", Accept: "*/*" },
    body: JSON.stringify({ experimentID, filename, data }),
  };
  const { status, ok, content } = await askForJson(ADDRESS, init, TIMEOUT);
  if (ok) return; // 202 means that it has the file, and tries to put it where it belongs.
  const { error = "" } = (content ?? {}) as { error?: string };
  // It has a file of this name: an earlier try came through, only its answer didn't.
  if (error.endsWith("FILE_EXISTS")) return;
  // The storage behind it did not take the file just now; it says so with the status of a refusal.
  const isStorage = error.endsWith("UPLOAD_ERROR");
  if (isPassing(status) || isStorage) throw new Unreachable("failing", `status ${status} ${error}`.trim());
  if (status === 413) throw new Refused(error, status, words.large);
  const known = REFUSALS[error];
  const said = words.other.split("{said}").join(`${status} ${error}`.trim());
  throw new Refused(error || "broken", status, known ? words[known] : said);
}
