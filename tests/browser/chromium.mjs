// The Chromium of the tests, and the looks that pages are shown in.
import { chromium } from 'playwright-core';

const FLAGS = [
  '--no-sandbox',
  '--disable-gpu',
  '--disable-quic',
  '--no-first-run',
  '--disable-background-networking',
  '--disable-component-update',
  '--disable-sync',
];

/** TROCAR_CHROMIUM names another than Debian's. */
export const launch = (more = []) =>
  chromium.launch({ executablePath: process.env.TROCAR_CHROMIUM ?? '/usr/bin/chromium', args: [...FLAGS, ...more] });

/** Both themes, on a desk and on a tablet. */
export const LOOKS = ['light', 'dark'].flatMap(colorScheme => [
  { name: `desk-${colorScheme}`, colorScheme, viewport: { width: 1440, height: 900 } },
  { name: `tablet-${colorScheme}`, colorScheme, viewport: { width: 820, height: 1180 } },
]);
