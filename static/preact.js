// Preact as the vendored file exports it, and `useId`, which that build lacks.
import { useState } from './vendor/preact-htm/standalone.module.js';

export * from './vendor/preact-htm/standalone.module.js';

let last = 0;

/** An id that is unique on the page and stays with the component: for labels. */
export function useId() {
  return useState(() => `id-${++last}`)[0];
}
