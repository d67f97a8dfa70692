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

/**
 * `load(signal)` runs at first, when `deps` change and on `reload()`; old `data` stays up until the new is there. `current` is
 * that data only while it answers the question that is asked now: for whatever would else stand under another choice.
 */
export function useData(load, deps) {
  const [{ data, problem, of }, setState] = useState({ data: undefined, problem: null, of: null });
  const running = useRef(null);
  const latest = useRef(null);
  latest.current = { load, deps };
  const reload = useCallback(async () => {
    running.current?.abort();
    const controller = (running.current = new AbortController());
    const { load, deps } = latest.current;
    try {
      const data = await load(controller.signal);
      if (!controller.signal.aborted) setState({ data, problem: null, of: deps });
    } catch (error) {
      if (!controller.signal.aborted) setState(before => ({ ...before, problem: asProblem(error) }));
    }
  }, []);
  useEffect(() => {
    reload();
    return () => running.current?.abort();
  }, deps);
  const isCurrent = of?.every((dep, at) => Object.is(dep, deps[at]));
  return { data, current: isCurrent ? data : undefined, problem, reload };
}

/**
 * A list that is read page by page with `load(cursor, signal)`, anew when `deps` change. `more()` reads on from where it stands,
 * after a failure, too, and does nothing while a page is under way.
 */
export function usePages(load, deps) {
  const [pages, setPages] = useState({ items: null, next: undefined, problem: null, busy: false });
  const running = useRef(null);
  const next = useRef(undefined); // undefined: nothing is there yet; null: that was all.
  const latest = useRef(load);
  latest.current = load;
  const read = useCallback(async () => {
    const controller = (running.current = new AbortController());
    const isFirst = next.current === undefined;
    setPages(before => ({ ...before, problem: null, busy: true }));
    try {
      const page = await latest.current(next.current, controller.signal);
      if (controller.signal.aborted) return;
      next.current = page.next ?? null;
      setPages(before => ({ items: isFirst ? page.items : [...before.items, ...page.items], next: next.current, problem: null, busy: false }));
    } catch (error) {
      if (!controller.signal.aborted) setPages(before => ({ ...before, problem: asProblem(error), busy: false }));
    }
    if (running.current === controller) running.current = null;
  }, []);
  const more = useCallback(() => running.current ?? read(), []);
  useEffect(() => {
    next.current = undefined;
    read();
    return () => running.current?.abort();
  }, deps);
  return { ...pages, more };
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
