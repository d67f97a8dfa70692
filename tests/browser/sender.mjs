// A box that sends: a page that plays a session's recording and streams its frames as JPEGs, as docs/feed.md has it. They
// are frames of a real clip, so that tools are really tracked.

/** Begins to send in `page`, which is signed in; returns the id of the session that arrives. */
export function beginFeed(page, { recording, box, trainee, task }) {
  return page.evaluate(send, { recording, box, trainee, task });
}

/** Ends the recording that `page` sends, and waits until the service has it whole. */
export function endFeed(page) {
  return page.evaluate(() => window.endFeed());
}

/** Runs in the page. */
async function send({ recording, box, trainee, task }) {
  const HEAD = 32;
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
  const pen = canvas.getContext('2d', { alpha: false });

  const socket = new WebSocket(`ws://${location.host}/api/v1/boxes/${box}/feed`);
  const heard = [];
  socket.onmessage = ({ data }) => heard.push(JSON.parse(data));
  socket.onclose = ({ code }) => heard.push({ type: 'closed', code });
  const answer = async type => {
    for (;;) {
      const word = heard.find(word => word.type === type || word.type === 'closed');
      if (word?.type === type) return word;
      if (word) throw new Error(`the feed was closed with ${word.code}`);
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
  const { session, epoch } = await answer('welcome');

  let [frames, began, ends] = [0, null, false];
  // By a timer: frames of a page that another one is opened over are not called back for.
  const capture = async () => {
    const now = performance.now();
    began ??= now;
    pen.drawImage(video, 0, 0);
    const jpeg = await new Promise(made => canvas.toBlob(made, 'image/jpeg', 0.92));
    const record = new Uint8Array(HEAD + jpeg.size);
    record.set(new Uint8Array(await jpeg.arrayBuffer()), HEAD);
    const head = new DataView(record.buffer);
    head.setUint8(0, 1); // A frame,
    head.setUint8(1, 1); // that can be decoded by itself.
    head.setUint32(4, epoch);
    head.setBigUint64(8, BigInt(frames));
    head.setBigInt64(16, BigInt(Math.round(now - began)));
    head.setUint32(24, jpeg.size);
    head.setUint32(28, crc(record.subarray(0, 28), record.subarray(HEAD)));
    if (ends || socket.readyState !== WebSocket.OPEN) return;
    socket.send(record);
    frames++;
    setTimeout(capture, Math.max(0, now + FRAME_MS - performance.now()));
  };
  await video.play();
  capture();

  window.endFeed = async () => {
    ends = true;
    socket.send(JSON.stringify({ type: 'end', frames }));
    await answer('ended');
    video.remove();
    return frames;
  };
  return session;
}
