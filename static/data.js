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

/** What is under way is waited for so long, ms, when it is asked for again; then its line may be gone, and it is begun anew. */
const PATIENCE_MS = 10_000;

/**
 * `load(signal)` runs at first, when `deps` change and on `reload()`; old `data` stays up until the new is there. A `reload()` while
 * one is under way runs behind it: events that come faster than answers hold no page up. `current` is that data only while it answers
 * the question that is asked now: for whatever would else stand under another choice.
 */
export function useData(load, deps) {
  const [{ data, problem, of }, setState] = useState({ data: undefined, problem: null, of: null });
  const running = useRef(null); // { controller, since, isAsked: once more, whole: what is told when nothing more is to be read }
  const latest = useRef(null);
  latest.current = { load, deps };
  const begin = useCallback(() => {
    running.current?.controller.abort();
    const run = (running.current = { controller: new AbortController(), since: Date.now(), isAsked: false });
    run.whole = read(run);
    return run.whole;
  }, []);
  async function read(run) {
    const { signal } = run.controller;
    const { load, deps } = latest.current;
    try {
      const data = await load(signal);
      if (!signal.aborted) setState({ data, problem: null, of: deps });
    } catch (error) {
      if (!signal.aborted) setState(before => ({ ...before, problem: asProblem(error) }));
    }
    if (signal.aborted) return undefined;
    running.current = null;
    return run.isAsked ? begin() : undefined;
  }
  const reload = useCallback(() => {
    const run = running.current;
    if (!run || Date.now() - run.since > PATIENCE_MS) return begin();
    run.isAsked = true;
    return run.whole;
  }, []);
  useEffect(() => {
    begin();
    return () => running.current?.controller.abort();
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
