"use strict";
// uPlot asks Intl for the browser's language; of some browsers that is a name which Intl refuses, such as en-US@posix.
try {
  Intl.getCanonicalLocales(navigator.language);
} catch {
  Object.defineProperty(navigator, "language", { value: "en-US", configurable: true });
}
