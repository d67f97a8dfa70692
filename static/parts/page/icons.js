// Line icons on a 24-unit grid with one stroke width. They are decoration; the text beside them carries the meaning.
import { html } from '../../preact.js';

const icon =
  paths =>
  ({ size = 20 } = {}) => html`
  <svg width=${size} height=${size} viewBox="0 0 24 24" fill="none" stroke="currentColor" stroke-width="2"
    stroke-linecap="round" stroke-linejoin="round" aria-hidden="true" focusable="false">
    ${paths.map(d => html`<path d=${d} />`)}
  </svg>`;

export const icons = {
  upload: icon(['M12 16V4', 'm7 9 5-5 5 5', 'M4 16v3a1 1 0 0 0 1 1h14a1 1 0 0 0 1-1v-3']),
  play: icon(['M8 5v14l11-7z']),
  record: icon(['M12 18a6 6 0 1 0 0-12 6 6 0 0 0 0 12z']),
  stop: icon(['M6 6h12v12H6z']),
  camera: icon(['M3 7h12v10H3z', 'm15 11 6-4v10l-6-4']),
  pause: icon(['M8 5v14', 'M16 5v14']),
  back: icon(['M18 6 9 12l9 6z', 'M5 6v12']),
  forward: icon(['m6 6 9 6-9 6z', 'M19 6v12']),
  full: icon(['M4 9V4h5', 'M20 9V4h-5', 'M4 15v5h5', 'M20 15v5h-5']),
  warning: icon(['M12 4 2.5 20h19z', 'M12 10v4', 'M12 17v.01']),
  good: icon(['M20 6 9 17l-5-5']),
  info: icon(['M12 21a9 9 0 1 0 0-18 9 9 0 0 0 0 18z', 'M12 11v5', 'M12 8v.01']),
  bridge: icon(['M3 12h3', 'M10.5 12h3', 'M18 12h3']),
  leave: icon(['M10 4H4v16h6', 'M9 12h12', 'm16 7 5 5-5 5']),
  close: icon(['m6 6 12 12', 'M18 6 6 18']),
  add: icon(['M12 5v14', 'M5 12h14']),
  sun: icon([
    'M12 16a4 4 0 1 0 0-8 4 4 0 0 0 0 8z',
    'M12 2v2M12 20v2M4.9 4.900l1.4 1.400M17.7 17.700l1.4 1.400M2 12h2M20 12h2M4.9 19.100l1.4-1.400M17.7 6.300l1.4-1.4',
  ]),
  moon: icon(['M20 14.500A8.5 8.5 0 0 1 9.5 4 8.5 8.5 0 1 0 20 14.500z']),
  system: icon(['M3 5h18v11H3z', 'M9 20h6', 'M12 16v4']),
  globe: icon(['M12 21a9 9 0 1 0 0-18 9 9 0 0 0 0 18z', 'M3 12h18', 'M12 3c5 5 5 13 0 18', 'M12 3c-5 5-5 13 0 18']),
};

/** The logo of the product: a tube with its tape band and tip. */
export const Brand = ({ size = 28 }) => html`
  <svg width=${size} height=${size} viewBox="0 0 32 32" aria-hidden="true" focusable="false">
    <rect width="32" height="32" rx="7" fill="#0b5c63" />
    <path d="M8 24 20 12" stroke="#fff" stroke-width="3.2" stroke-linecap="round" />
    <path d="m17.5 14.5 2.5-2.5" stroke="#ffb067" stroke-width="6" />
    <circle cx="23.3" cy="8.7" r="2.6" fill="none" stroke="#7be0e6" stroke-width="2" />
  </svg>`;
