// A shared worker: one stream of news for all open pages of a browser.  Over HTTP/1.1 a browser opens six connections
// to a server, and with a stream for each page the seventh page would never come.

import { open } from "./source.js";

const pages = new Set();
let source = null, last = null;

function tell(message) {
  last = message;
  for (const page of pages) page.postMessage(message);
  if (message.closed) { source.close(); source = null; }
}

self.addEventListener("connect", (event) => {
  const [page] = event.ports;
  page.addEventListener("message", () => {
    pages.delete(page);
    if (!pages.size && source) { source.close(); source = last = null; }
  });
  page.start();
  pages.add(page);
  if (source === null) { source = open(tell); last = null; }
  else if (last) page.postMessage(last);
});
