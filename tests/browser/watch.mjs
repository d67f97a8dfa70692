// What a page must not do, noted while it is used: ask another origin, break the content security policy, throw.

/** Answers of ours that are expected and that Chromium writes to its console all the same. */
const EXPECTED = /status of 401/;

/** Watches from now on; the returned function tells what was seen. */
export function tracesOf(page, origin) {
  const foreign = [];
  const broken = [];
  page.on('request', request => {
    const at = request.url();
    if (!at.startsWith(`${origin}/`) && !/^(blob|data):/.test(at)) foreign.push(at);
  });
  page.on('websocket', socket => {
    if (!socket.url().startsWith(`${origin.replace(/^http/, 'ws')}/`)) foreign.push(socket.url());
  });
  page.on('pageerror', error => broken.push(error.message));
  page.on('console', message => {
    if (message.type() === 'error' && !EXPECTED.test(message.text()))
      broken.push(`${message.text()} ${message.location().url}`);
  });
  return () => ({ foreign, broken });
}
