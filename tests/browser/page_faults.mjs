// Records what a page must never do: call another origin, violate the content security policy, throw an error.

/** Expected answers of the service that Chromium nevertheless logs as errors. */
const EXPECTED = /status of 401/;

/** Watches the page from now on; the returned function returns the requests to other origins and the errors so far. */
export function watchForFaults(page, origin) {
  const foreign = [];
  const errors = [];
  page.on('request', request => {
    const at = request.url();
    if (!at.startsWith(`${origin}/`) && !/^(blob|data):/.test(at)) foreign.push(at);
  });
  page.on('websocket', socket => {
    if (!socket.url().startsWith(`${origin.replace(/^http/, 'ws')}/`)) foreign.push(socket.url());
  });
  page.on('pageerror', error => errors.push(error.message));
  page.on('console', message => {
    if (message.type() === 'error' && !EXPECTED.test(message.text()))
      errors.push(`${message.text()} ${message.location().url}`);
  });
  return () => ({ foreign, errors });
}
