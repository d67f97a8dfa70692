// Loading for a page: data, problem and a way to load again, with the answer of an abandoned page thrown away.
import { useCallback, useEffect, useRef, useState } from './parts/preact.js';
import { Problem } from './api.js';
import { t } from './texts.js';

/** What went wrong, as a problem, whatever was thrown. */
export function asProblem(error) {
  if (error instanceof Problem) return error;
  console.error(error);
  return new Problem({ title: t.problems.broken, status: 0, detail: t.problems.brokenDetail });
}

/** `load(signal)` runs at first, when `deps` change and on `reload()`; old data stays up until the new is there. */
export function useData(load, deps) {
  const [state, setState] = useState({ data: undefined, problem: null });
  const running = useRef(null);
  const latest = useRef(load);
  latest.current = load;
  const reload = useCallback(async () => {
    running.current?.abort();
    const controller = (running.current = new AbortController());
    try {
      const data = await latest.current(controller.signal);
      if (!controller.signal.aborted) setState({ data, problem: null });
    } catch (error) {
      if (!controller.signal.aborted) setState(before => ({ ...before, problem: asProblem(error) }));
    }
  }, []);
  useEffect(() => {
    reload();
    return () => running.current?.abort();
  }, deps);
  return { ...state, reload };
}

/** At most one call per `ms`, the last one never lost: for reloading on bursts of events. */
export function useThrottled(callback, ms) {
  const latest = useRef(callback);
  latest.current = callback;
  const timer = useRef(null);
  const last = useRef(0);
  useEffect(() => () => clearTimeout(timer.current), []);
  return useCallback(() => {
    if (timer.current) return;
    const wait = Math.max(0, last.current + ms - Date.now());
    timer.current = setTimeout(() => {
      timer.current = null;
      last.current = Date.now();
      latest.current();
    }, wait);
  }, [ms]);
}
