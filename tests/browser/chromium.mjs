// Starts Chromium for the tests, and lists the looks: the combinations of theme and screen size.
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

/** Uses Debian's Chromium unless TROCAR_CHROMIUM names another one. */
export const launch = (more = []) =>
  chromium.launch({ executablePath: process.env.TROCAR_CHROMIUM ?? '/usr/bin/chromium', args: [...FLAGS, ...more] });

/** Both themes, on a desktop screen and on a tablet. */
export const LOOKS = ['light', 'dark'].flatMap(colorScheme => [
  { name: `desk-${colorScheme}`, colorScheme, viewport: { width: 1440, height: 900 } },
  { name: `tablet-${colorScheme}`, colorScheme, viewport: { width: 820, height: 1180 } },
]);
