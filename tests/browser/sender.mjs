// Simulates a box that sends live: a page plays a session's recording and streams its frames as JPEGs, following the
// protocol of docs/feed.md. The frames come from a real clip, so that the service can track the tools.

/** Starts to send in `page`, which has to be signed in; returns the id of the session that receives the frames. */
export function beginFeed(page, { recording, box, trainee, task }) {
  return page.evaluate(send, { recording, box, trainee, task });
}

/**
 * Ends the recording that `page` sends, waits until the service has all of it, and returns the number of frames sent.
 */
export function endFeed(page) {
  return page.evaluate(() => window.endFeed());
}

/** Runs in the page. */
async function send({ recording, box, trainee, task }) {
  const HEADER_BYTES = 32;
  const FRAME_MS = 40;
  const table = Uint32Array.from({ length: 256 }, (_, n) => {
    for (let bit = 0; bit < 8; bit++) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
    return n;
  });
  const crc = (...parts) => {
    let sum = 0xffffffff;
    for (const part of parts) for (const byte of part) sum = table[(sum ^ byte) & 255] ^ (sum >>> 8);
    return ~sum >>> 0;
  };

  const video = Object.assign(document.createElement('video'), { muted: true, loop: true, preload: 'auto' });
  video.src = `/api/v1/sessions/${recording}/video`;
  await new Promise((ready, failed) => Object.assign(video, { oncanplay: ready, onerror: failed }));
  const [width, height] = [video.videoWidth, video.videoHeight];
  const canvas = Object.assign(document.createElement('canvas'), { width, height });
  const context = canvas.getContext('2d', { alpha: false });

  const socket = new WebSocket(`ws://${location.host}/api/v1/boxes/${box}/feed`);
  const received = [];
  socket.onmessage = ({ data }) => received.push(JSON.parse(data));
  socket.onclose = ({ code }) => received.push({ type: 'closed', code });
  const receive = async type => {
    for (;;) {
      const message = received.find(message => message.type === type || message.type === 'closed');
      if (message?.type === type) return message;
      if (message) throw new Error(`the feed was closed with ${message.code}`);
      await new Promise(later => setTimeout(later, 20));
    }
  };
  await new Promise(opened => (socket.onopen = opened));
  socket.send(
    JSON.stringify({
      type: 'hello',
      protocol: 1,
      recording: crypto.randomUUID(),
      ...{ trainee, task, codec: 'jpeg', width, height, time_base: [1, 1000], sender: 'browser test' },
      began_at: new Date().toISOString(),
    }),
  );
  const { session, epoch } = await receive('welcome');

  let [frames, began, isEnding] = [0, null, false];
  // Uses a timer, because Chromium runs no animation frame callbacks for a page that is hidden behind another one.
  const capture = async () => {
    const now = performance.now();
    began ??= now;
    context.drawImage(video, 0, 0);
    const jpeg = await new Promise(made => canvas.toBlob(made, 'image/jpeg', 0.92));
    const record = new Uint8Array(HEADER_BYTES + jpeg.size);
    record.set(new Uint8Array(await jpeg.arrayBuffer()), HEADER_BYTES);
    const head = new DataView(record.buffer);
    head.setUint8(0, 1); // Record type: a frame.
    head.setUint8(1, 1); // Flag: a key frame.
    head.setUint32(4, epoch);
    head.setBigUint64(8, BigInt(frames));
    head.setBigInt64(16, BigInt(Math.round(now - began)));
    head.setUint32(24, jpeg.size);
    head.setUint32(28, crc(record.subarray(0, 28), record.subarray(HEADER_BYTES)));
    if (isEnding || socket.readyState !== WebSocket.OPEN) return;
    socket.send(record);
    frames++;
    setTimeout(capture, Math.max(0, now + FRAME_MS - performance.now()));
  };
  await video.play();
  capture();

  window.endFeed = async () => {
    isEnding = true;
    socket.send(JSON.stringify({ type: 'end', frames }));
    await receive('ended');
    video.remove();
    return frames;
  };
  return session;
}
