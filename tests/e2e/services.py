"""Stand-ins for services that collect answers, failing as these do."""

import json


class DataPipe:
    """DataPipe as it is set when an experiment is new there, by its own source.

    https://github.com/jspsych/datapipe: functions/src/api-data.ts, validate-json.ts and
    validate-csv.ts, create-experiment.ts. `fates` says what becomes of the next requests: a status
    and an error code, or "lost", for an answer that doesn't arrive.
    """

    def __init__(self, experiment="ABC123"):
        self.experiment = experiment
        self.active = True
        self.required = ["trial_type"]
        self.files = {}
        self.fates = []
        self.asked = 0

    def answer(self, route):
        """Answer a request of the page."""
        self.asked += 1
        fate = self.fates.pop(0) if self.fates else None
        if isinstance(fate, tuple):
            status, error = fate
        else:
            status, error = self._take(route.request.post_data_json)
        if fate == "lost":
            route.abort()
            return
        headers = {"Access-Control-Allow-Origin": "*", "Access-Control-Allow-Headers": "*"}
        route.fulfill(status=status, headers=headers, json={"error": error, "message": "Words."})

    def _take(self, asked):
        data, name = asked["data"], asked["filename"]
        if asked["experimentID"] != self.experiment:
            return 400, "EXPERIMENT_NOT_FOUND"
        if not self.active:
            return 400, "DATA_COLLECTION_NOT_ACTIVE"
        if not (self._is_valid_json(data) or self._is_valid_csv(data)):
            return 400, "INVALID_DATA"
        if name in self.files:
            return 400, "FILE_EXISTS"
        self.files[name] = data
        return 201, None

    def _is_valid_json(self, data):
        try:
            content = json.loads(data)
        except ValueError:
            return False
        objects = content if isinstance(content, list) else [content]
        fields = {field for one in objects for field in one}
        return fields.issuperset(self.required)

    def _is_valid_csv(self, data):
        header = data.split("\n", 1)[0].split(",")
        return set(header).issuperset(self.required)


JATOS = """
{
  const failing = (sessionStorage.failing ?? "").split(" ").filter(Boolean);
  const send = async (what, work) => {
    const fate = failing.shift();
    sessionStorage.failing = failing.join(" ");
    if (fate && fate !== "lost" && fate !== "fine") throw `POST to ${what} failed: ${fate}`;
    work();
    if (fate === "lost") throw `POST to ${what} failed: timeout`;
  };
  let endings = 0;
  window.jatos = {
    studySessionData: JSON.parse(sessionStorage.session ?? "{}"),
    urlQueryParameters: { PROLIFIC_PID: "p7" },
    onLoad: (callback) => setTimeout(callback, 50),
    setStudySessionData: (data) => {
      jatos.studySessionData = data;
      return send("studySessionData", () => { sessionStorage.session = JSON.stringify(data); });
    },
    appendResultData: (data) => send("resultData", () => {
      sessionStorage.results = (sessionStorage.results ?? "") + data;
    }),
    endStudyWithoutRedirect: async (successful) => {
      if (endings++) throw "Can end/abort study only once.";
      await send("end", () => { sessionStorage.ended = successful; });
    },
  };
}
"""
"""As much of jatos.js 3.10 as the page uses; its results are where a test can see them.

`sessionStorage.failing` has the fates of what is sent next: "fine", "lost" for an answer that does
not arrive, a status, or "offline". jatos.js rejects with a text, takes the session's data for set
even if they were lost, and asks for the study's end once.
"""
