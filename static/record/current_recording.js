// The recording that this browser makes, if any, and callbacks for its changes. Every page imports this; the recorder
// itself is loaded only by pages that record.

/**
 * The phases during which leaving the page would lose data. All phases: `'recording'`, `'sending'` (stopped, not all is
 * on the server), `'ended'`, `'shortened'` (the server ended it without the last part), `'refused'` (the rest is kept
 * until the person decides), `'nothing'` and `'failed'`.
 */
const UNSAVED_PHASES = ['recording', 'sending'];

const watchers = new Set();

/**
 * Null, or the state of the recording: `{ phase, names, why, …status }`. `why` is the reason if it stopped by itself;
 * `isCaptured` says that no frames are captured while the tab is hidden; the status is as worker.js posts it.
 *
 * @type {any}
 */
export let currentRecording = null;

export const isRecording = () => UNSAVED_PHASES.includes(currentRecording?.phase);

export function onRecording(callback) {
  watchers.add(callback);
  return () => watchers.delete(callback);
}

export function updateRecording(more) {
  currentRecording = more && { ...currentRecording, ...more };
  watchers.forEach(callback => callback());
}
