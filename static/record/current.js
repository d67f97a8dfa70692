// The recording that this browser makes, if it makes one, and who is told when that changes. Every page asks; what records is loaded by
// those pages that record.

/** Of the phases `'recording'`, `'sending'` (stopped, not all is on the server), `'ended'`, `'shortened'` (the server ended it
 *  without the last of it), `'refused'` (what is left is kept
 *  until the person decides), `'nothing'` and `'failed'` those in which a page that is left takes something with it. */
const BUSY = ['recording', 'sending'];

const watchers = new Set();

/**
 * Null, or how the recording stands: `{ phase, names, why, …standing }`; `why` is why it stopped by
 * itself, `isCaptured` says that frames end while the tab is hidden, the standing is as worker.js tells it.
 */
export let now = null;

export const isRecording = () => BUSY.includes(now?.phase);

export function onRecording(callback) {
  watchers.add(callback);
  return () => watchers.delete(callback);
}

export function change(more) {
  now = more && { ...now, ...more };
  watchers.forEach(tell => tell());
}
