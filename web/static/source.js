// The stream of the robot's news, by which a page or the worker of all pages hears what happens.

const NAMES = ["cards", "trouble"];

// tell({ name, data }) for each event, and { name: "open" } and { name: "error", closed } for the connection.
export function open(tell) {
  const source = new EventSource("/api/events");
  source.addEventListener("open", () => tell({ name: "open" }));
  source.addEventListener("error", () => tell({ name: "error", closed: source.readyState === EventSource.CLOSED }));
  for (const name of NAMES) {
    source.addEventListener(name, (event) => tell({ name, data: JSON.parse(event.data) }));
  }
  return source;
}
