// What somebody has under their hands while they set up a box: photos, frames, marks. It outlasts the page, so that a look at
// another one costs nothing; sizes and tools are remembered in this browser. Nobody else who signs in here sees it.
import { useEffect, useMemo, useState } from '../parts/preact.js';

const KEY = 'trocar.setup';
/** `printed`: a square's side as the sheet has it, `square`: as it was measured on paper, mm. */
const USUAL = { columns: 9, rows: 6, printed: 21, square: 21, measured: false, tools: [] };
const benches = new Map();

class Bench {
  constructor(key) {
    this.key = `${KEY}.${key}`;
    this.plan = remembered(this.key);
    this.photos = [];
    this.frames = [];
    this.job = {}; // By step: the job that was begun there.
    this.listeners = new Set();
  }

  /** The board and the tools, as far as this browser was told. */
  setPlan(more) {
    this.plan = { ...this.plan, ...more };
    remember(this.key, this.plan);
    this.tell();
  }

  tell() {
    this.listeners.forEach(listener => listener());
  }

  /** Is there anything that only this page has? */
  get isLaden() {
    return (this.photos.length > 0 && !this.job.calibration) || (this.frames.length > 0 && !this.job.colours);
  }
}

/** The bench of this person and box; the page is drawn anew whenever something on it changes. */
export function useBench(person, box) {
  const key = `${person}.${box}`;
  const bench = useMemo(() => {
    if (!benches.has(key)) benches.set(key, new Bench(key));
    return benches.get(key);
  }, [key]);
  const [, draw] = useState(0);
  useEffect(() => {
    const listener = () => draw(count => count + 1);
    bench.listeners.add(listener);
    const warn = event => bench.isLaden && event.preventDefault();
    addEventListener('beforeunload', warn);
    return () => (bench.listeners.delete(listener), removeEventListener('beforeunload', warn));
  }, [bench]);
  return bench;
}

function remembered(key) {
  try {
    return { ...USUAL, ...JSON.parse(localStorage.getItem(key)) };
  } catch {
    return USUAL;
  }
}

function remember(key, plan) {
  try {
    localStorage.setItem(key, JSON.stringify(plan));
  } catch {
    // Storage is refused: it is asked again the next time.
  }
}
