// Page addresses such as `/sessions/7?t=3.2`. The server answers all of them with the dashboard; routes.js
// lists the pages.
import { useEffect, useState } from './preact.js';
import { basePath } from './base_path.js';

const CHANGED = 'trocar:route';

/** The address as data: `/sessions/7?t=3.2` → `{ path: ['sessions', '7'], query }`. */
export function currentRoute() {
  return {
    path: location.pathname.slice(basePath.length).split('/').filter(Boolean).map(decode),
    query: new URLSearchParams(location.search),
  };
}

/** The address of a page; empty query values are left out. */
export function href(path, query = {}) {
  const params = Object.entries(query).filter(([, value]) => value !== undefined && value !== null && value !== '');
  const search = new URLSearchParams(params).toString();
  return `${basePath}/${path.map(encodeURIComponent).join('/')}${search ? `?${search}` : ''}`;
}

export function go(path, query) {
  pushAddress(href(path, query));
}

/** Changes the address without a new entry in the browser's history: for filters and the time in a video. */
export function replace(path, query) {
  history.replaceState(null, '', href(path, query));
  dispatchEvent(new Event(CHANGED));
}

/** Writes into the address what a link to this state should contain, without changing the page. */
export function setAddressSilently(path, query) {
  history.replaceState(null, '', href(path, query));
}

function pushAddress(address) {
  history.pushState(null, '', address);
  dispatchEvent(new Event(CHANGED));
}

/** A plain click on an internal link changes the page without reloading the app. */
addEventListener('click', event => {
  const link = /** @type {HTMLAnchorElement | null} */ (/** @type {Element} */ (event.target).closest?.('a[href]'));
  const plain = event.button === 0 && !event.metaKey && !event.ctrlKey && !event.shiftKey && !event.altKey;
  if (!link || !plain || event.defaultPrevented || link.target || link.hasAttribute('download')) return;
  const address = link.getAttribute('href') ?? '';
  if (address.startsWith('//') || !address.startsWith(`${basePath}/`) || /^\/(api|docs)\b/.test(address.slice(basePath.length))) return;
  event.preventDefault();
  if (address !== location.pathname + location.search) pushAddress(address);
});

export function useRoute() {
  const [route, setRoute] = useState(currentRoute);
  useEffect(() => {
    const change = () => setRoute(currentRoute());
    for (const name of ['popstate', CHANGED]) addEventListener(name, change);
    return () => ['popstate', CHANGED].forEach(name => removeEventListener(name, change));
  }, []);
  return route;
}

function decode(part) {
  try {
    return decodeURIComponent(part);
  } catch {
    return part; // A stray % typed by hand is no reason to show nothing.
  }
}
