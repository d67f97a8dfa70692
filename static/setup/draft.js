// The unsaved work of a box setup: photos, frames, marks, a picture of the empty box. It outlasts the page, so that a
// look at another page loses nothing; sizes and tools are stored in this browser. Every person has their own.
import { useEffect, useMemo, useState } from '../preact.js';

const KEY = 'trocar.setup';
/** `printed`: a square's side on the sheet; `square`: as measured on paper, mm. */
const DEFAULT_PLAN = { columns: 9, rows: 6, printed: 21, square: 21, measured: false, tools: [] };
const drafts = new Map();

class SetupDraft {
  constructor(key) {
    this.key = `${KEY}.${key}`;
    this.plan = loadPlan(this.key);
    this.photos = [];
    this.frames = [];
    this.emptyBox = undefined; // A picture; undefined: the stored one stays; null: it is removed.
    this.job = {}; // By step: the job that was started there.
    this.listeners = new Set();
  }

  /** The board and the tools, as stored in this browser. */
  setPlan(more) {
    this.plan = { ...this.plan, ...more };
    storePlan(this.key, this.plan);
    this.notify();
  }

  notify() {
    this.listeners.forEach(listener => listener());
  }

  /** Whether anything would be lost with this page. */
  get hasUnsavedWork() {
    return (this.photos.length > 0 && !this.job.calibration) || ((this.frames.length > 0 || this.emptyBox) && !this.job.colours);
  }
}

/** The draft of this person and box; the page is rendered again whenever it changes. */
export function useSetupDraft(person, box) {
  const key = `${person}.${box}`;
  const draft = useMemo(() => {
    if (!drafts.has(key)) drafts.set(key, new SetupDraft(key));
    return drafts.get(key);
  }, [key]);
  const [, render] = useState(0);
  useEffect(() => {
    const listener = () => render(count => count + 1);
    draft.listeners.add(listener);
    const warn = event => draft.hasUnsavedWork && event.preventDefault();
    addEventListener('beforeunload', warn);
    return () => (draft.listeners.delete(listener), removeEventListener('beforeunload', warn));
  }, [draft]);
  return draft;
}

function loadPlan(key) {
  try {
    return { ...DEFAULT_PLAN, ...JSON.parse(localStorage.getItem(key) ?? '{}') };
  } catch {
    return DEFAULT_PLAN;
  }
}

function storePlan(key, plan) {
  try {
    localStorage.setItem(key, JSON.stringify(plan));
  } catch {
    // Storage is refused: the person enters it again the next time.
  }
}
