// Takes frames of a recording in the set-up page, paints on them, and measures what their masks cover.

/** Shows the recording at a moment, s, and takes that frame. */
export async function takeFrame(page, second) {
  const before = await page.locator('.frames li').count();
  await showMoment(page, second);
  await page.getByRole('button', { name: 'Take this frame' }).click();
  await page.locator('.frames li').nth(before).waitFor();
}

/** Shows the recording at a moment, s. */
export const showMoment = (page, second) =>
  page.locator('.setup-step video').evaluate(async (video, at) => {
    const sought = new Promise(done => video.addEventListener('seeked', done, { once: true }));
    video.currentTime = at;
    await sought;
    await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
  }, second);

/** Sets the brush to a rectangle of the frame, and draws a stroke of the mouse through its middle. */
export async function paint(page, { x, y, w, h }) {
  await page.locator('.size input').fill(String(Math.max(3, Math.round(0.6 * Math.min(w, h)))));
  const canvas = page.locator('.painter canvas.paint');
  await canvas.scrollIntoViewIfNeeded();
  const [size, { width, height }] = [await canvas.boundingBox(), await canvas.evaluate(({ width, height }) => ({ width, height }))];
  const at = (u, v) => [size.x + (u * size.width) / width, size.y + (v * size.height) / height];
  await page.mouse.move(...at(x + w * 0.3, y + h / 2));
  await page.mouse.down();
  await page.mouse.move(...at(x + w * 0.7, y + h / 2), { steps: 4 });
  await page.mouse.up();
}

/** The share of a rectangle of a frame that the frame's mask covers, 0 to 1. */
export const covered = (page, frame, rectangle) =>
  page.locator(`.frames li[data-frame="${frame}"] canvas.mask`).evaluate((mask, { x, y, w, h }) => {
    const cell = 2;
    const pixels = mask.getContext('2d').getImageData(x / cell, y / cell, Math.max(1, w / cell), Math.max(1, h / cell)).data;
    let inked = 0;
    for (let i = 3; i < pixels.length; i += 4) inked += pixels[i] > 0;
    return inked / (pixels.length / 4);
  }, rectangle);
