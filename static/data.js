// Loads data for a page: data, problem and a way to load again. Answers for an abandoned page are discarded.
import { useCallback, useEffect, useRef, useState } from './preact.js';
import { Problem } from './api.js';
import { t } from './texts.js';

/**
 * Turns any error into a problem.
 *
 * @param {unknown} error
 */
export function asProblem(error) {
  if (error instanceof Problem) return error;
  console.error(error);
  return new Problem({ title: t.problems.broken, status: 0, detail: t.problems.brokenDetail });
}

/**
 * A request that runs longer than this, ms, may have lost its connection: a reload then starts anew and does not wait.
 */
const STALE_REQUEST_MS = 10_000;

/**
 * Runs `load(signal)` at first, when `deps` change and on `reload()`; old `data` stays until the new data arrive. A
 * `reload()` during a running load starts another one after it, so that frequent events do not block the page.
 * `current` is `data` only while it belongs to the present `deps`: use it where data of an earlier choice would be
 * wrong.
 *
 * @template T
 * @param {(signal: AbortSignal) => T} load
 * @param {unknown[]} deps
 */
export function useData(load, deps) {
  /** @type {{ data: Awaited<T> | undefined, problem: Problem | null, loadedFor: unknown[] | null }} */
  const initial = { data: undefined, problem: null, loadedFor: null };
  const [{ data, problem, loadedFor }, setState] = useState(initial);
  // { controller, since, reloadRequested, finished: resolves when no further load follows }
  const running = useRef(null);
  const latest = useRef(null);
  latest.current = { load, deps };
  const begin = useCallback(() => {
    running.current?.controller.abort();
    /** @type {{ controller: AbortController, since: number, reloadRequested: boolean, finished?: Promise<void> }} */
    const run = (running.current = { controller: new AbortController(), since: Date.now(), reloadRequested: false });
    run.finished = read(run);
    return run.finished;
  }, []);
  async function read(run) {
    const { signal } = run.controller;
    const wanted = latest.current;
    try {
      const loaded = await wanted.load(signal);
      if (!signal.aborted) setState({ data: loaded, problem: null, loadedFor: wanted.deps });
    } catch (error) {
      if (!signal.aborted) setState(before => ({ ...before, problem: asProblem(error) }));
    }
    if (signal.aborted) return undefined;
    running.current = null;
    return run.reloadRequested ? begin() : undefined;
  }
  const reload = useCallback(() => {
    const run = running.current;
    if (!run || Date.now() - run.since > STALE_REQUEST_MS) return begin();
    run.reloadRequested = true;
    return run.finished;
  }, []);
  useEffect(() => {
    begin();
    return () => running.current?.controller.abort();
  }, deps);
  const isCurrent = loadedFor?.every((dep, at) => Object.is(dep, deps[at]));
  return { data, current: isCurrent ? data : undefined, problem, reload };
}

/**
 * A list that is loaded page by page with `load(cursor, signal)`, restarted when `deps` change. `more()` loads the next
 * page, also after a failure; it does nothing while a page is loading.
 *
 * @template T
 * @param {(cursor: string | undefined, signal: AbortSignal) => Promise<{ items: T[], next?: string | null }>} load
 * @param {unknown[]} deps
 */
export function usePages(load, deps) {
  /** @type {{ items: T[] | null, next: string | null | undefined, problem: Problem | null, busy: boolean }} */
  const initial = { items: null, next: undefined, problem: null, busy: false };
  const [pages, setPages] = useState(initial);
  const running = useRef(null);
  const next = useRef(undefined); // undefined: nothing is loaded yet; null: the list is complete.
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
      setPages(before => ({ items: isFirst ? page.items : [...(before.items ?? []), ...page.items], next: next.current, problem: null, busy: false }));
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

/**
 * At most one call per `ms`, and the last call is never lost: for reloading on bursts of events.
 *
 * @param {() => unknown} callback
 * @param {number} ms
 */
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
