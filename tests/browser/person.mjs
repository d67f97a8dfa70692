// A user of the pages in a test: signs in, checks every look, takes screenshots, and calls REST as any program may.
//
// Environment: TROCAR_URL, TROCAR_LOGIN, TROCAR_PASSWORD. Optional: TROCAR_SCREENSHOTS (a folder for screenshots in all
// looks), TROCAR_CHROMIUM (default /usr/bin/chromium), TROCAR_PATIENCE_S (how many seconds a score may take, default
// 180).
import assert from 'node:assert/strict';
import { mkdirSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';

import { LOOKS } from './chromium.mjs';
import { watchForFaults } from './page_faults.mjs';

export const requiredEnv = name => process.env[name] ?? assert.fail(`set ${name}: see the head of this file`);
export const url = requiredEnv('TROCAR_URL').replace(/\/$/, '');
export const [login, password] = [requiredEnv('TROCAR_LOGIN'), requiredEnv('TROCAR_PASSWORD')];
export const timeoutMs = 1000 * Number(process.env.TROCAR_PATIENCE_S ?? 180);
const screenshotFolder = process.env.TROCAR_SCREENSHOTS;
if (screenshotFolder) mkdirSync(screenshotFolder, { recursive: true });

export async function signIn(page, secret = password, name = login) {
  await page.fill('input[name=login]', name);
  await page.fill('input[name=password]', secret);
  await page.click('button[type=submit]');
}

/** Sends a GET request to REST with the browser's sign-in, and returns the JSON answer. */
export const getJson = (page, path) => page.evaluate(async at => (await fetch(at)).json(), `/api/v1/${path}`);

/** Creates the resource that the path names, and returns the JSON answer of REST. */
export const create = (page, path, json) =>
  page.evaluate(
    async ([at, body]) => {
      const answer = await fetch(at, { method: 'POST', headers: { 'Content-Type': 'application/json' }, body });
      if (!answer.ok) throw new Error(`${at}: ${answer.status} ${await answer.text()}`);
      return answer.json();
    },
    [`/api/v1/${path}`, JSON.stringify(json)],
  );

async function applyLook(page, { colorScheme, viewport }) {
  await page.setViewportSize(viewport);
  await page.emulateMedia({ colorScheme });
}

/** How much wider the page is than the screen, pixels. */
const excessWidth = page =>
  page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);

/**
 * Shows the page in every look, asserts that it is not wider than the screen, and runs `check(look)`. With
 * TROCAR_SCREENSHOTS it also saves a screenshot of each look.
 */
export async function checkLooks(page, name, check = () => {}) {
  const viewport = page.viewportSize();
  for (const look of LOOKS) {
    await applyLook(page, look);
    await waitForRedraw(page); // Until then a curve still has the width of the previous look.
    if (screenshotFolder) {
      await page.evaluate(() => scrollTo(0, 0)); // On a scrolled page the header would appear in the middle.
      await page.screenshot({ path: join(screenshotFolder, `${name}-${look.name}.png`), fullPage: true });
    }
    const excess = await excessWidth(page);
    assert.ok(excess <= 0, `${name} is ${excess} px wider than a ${look.name}`);
    await check(look);
  }
  await applyLook(page, { colorScheme: 'light', viewport });
}

/** Saves a screenshot in every look, but only if TROCAR_SCREENSHOTS is set, because it takes seconds. */
export const takePictures = (page, name) => screenshotFolder && checkLooks(page, name);

/** Waits 12 animation frames: after a change of size or theme the pages redraw their canvases, one in each frame. */
const waitForRedraw = page =>
  page.evaluate(() => new Promise(done => {
    let frames = 12;
    const next = () => (frames-- ? requestAnimationFrame(next) : done());
    next();
  }));

const A4_PX = { width: 794, height: 1123 };

/**
 * Prints the page to a PDF and returns it. With TROCAR_SCREENSHOTS it also saves the PDF and a screenshot of the paper.
 */
export async function printToPdf(page, name) {
  const viewport = page.viewportSize();
  await page.emulateMedia({ media: 'print' });
  const pdf = await page.pdf({ preferCSSPageSize: true });
  if (screenshotFolder) {
    writeFileSync(join(screenshotFolder, `${name}-paper.pdf`), pdf);
    await page.setViewportSize(A4_PX);
    await waitForRedraw(page);
    await page.screenshot({ path: join(screenshotFolder, `${name}-paper.png`), fullPage: true });
    await page.setViewportSize(viewport);
  }
  await page.emulateMedia({ media: 'screen' });
  return pdf;
}

/** Opens an address and waits until the page has loaded its data. */
export async function open(page, path) {
  await page.goto(url + path);
  await page.locator('main h1').waitFor();
  await page.waitForFunction(() => !document.querySelector('main .loading'));
}

export async function waitUntil(condition, what) {
  const end = Date.now() + timeoutMs;
  while (!(await condition())) {
    assert.ok(Date.now() < end, `${what}: not in time`);
    await new Promise(done => setTimeout(done, 100));
  }
}

/** How many pages a PDF has: it contains one object of type Page for each. */
export const pagesOf = pdf => pdf.toString('latin1').match(/\/Type\s*\/Page\b(?!s)/g)?.length ?? 0;

/**
 * Opens a page in a browser context of its own, and returns the functions above bound to that page. `prefix` begins the
 * file names of this user's screenshots.
 */
export async function person(browser, { viewport = LOOKS[0].viewport, prefix = '' } = {}) {
  const context = await browser.newContext({ viewport, colorScheme: 'light' });
  const page = await context.newPage();
  return {
    page,
    pageFaults: watchForFaults(page, url),
    signIn: (secret, name) => signIn(page, secret, name),
    getJson: path => getJson(page, path),
    create: (path, json) => create(page, path, json),
    checkLooks: (name, check) => checkLooks(page, prefix + name, check),
    takePictures: name => takePictures(page, prefix + name),
    printToPdf: name => printToPdf(page, prefix + name),
    open: path => open(page, path),
    button: name => page.getByRole('button', { name, exact: true }),
    heading: words => page.locator('main h1', { hasText: words }),
  };
}
