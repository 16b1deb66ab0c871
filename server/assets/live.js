// Keeps what is marked `data-live` up to date: an event of the server says that something has changed, and the page is
// fetched again. Without scripts the page works, and a reload does the same.
"use strict";
const source = document.body.dataset.events;
if (source) {
  let pending = false;
  const refresh = async () => {
    if (pending || document.hidden) return;
    pending = true;
    try {
      const answer = await fetch(location.href, { headers: { accept: "text/html" } });
      if (!answer.ok) return;
      const fresh = new DOMParser().parseFromString(await answer.text(), "text/html");
      for (const part of document.querySelectorAll("[data-live]")) {
        const other = fresh.querySelector(`[data-live="${part.dataset.live}"]`);
        // What somebody has the focus in, or has chosen something in, stays as it is.
        const busy = part.contains(document.activeElement) || part.querySelector("input:checked");
        if (other && !busy) part.replaceWith(other);
      }
      document.body.dataset.updated = String(Date.now());
    } finally {
      pending = false;
    }
  };
  const events = new EventSource(source);
  events.addEventListener("change", refresh);
  document.addEventListener("visibilitychange", refresh);
}
