/**
 * What stands on the page before the study does, in the JavaScript of 2009: why the page stays
 * empty, where it does.
 */
(function () {
  var page = document.getElementById("page") as HTMLElement;

  function say(words: string, cause: string) {
    if (page.innerHTML) return;
    var text = document.createElement("p");
    text.textContent = (page.getAttribute("data-" + words) || "").replace("{cause}", cause);
    page.appendChild(text);
  }

  // Chrome 86, Firefox 78 and Safari 14 brought it; package.json has the oldest browsers that are served.
  if (!("replaceChildren" in page)) say("old", "");

  // Scripts that don't arrive are told of to those alone who listen to the way down.
  window.addEventListener(
    "error",
    function (event) {
      var from = event.target as HTMLElement | null;
      if (from && from.tagName === "SCRIPT") say("unloaded", "");
      else if (event.message) say("broken", event.message);
    },
    true,
  );
})();
