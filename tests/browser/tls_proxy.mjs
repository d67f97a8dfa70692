// A TLS proxy such as the README requires in front of the service on a network; like all common ones, it speaks HTTP/2.
import { execFileSync } from 'node:child_process';
import { once } from 'node:events';
import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { Agent, request } from 'node:http';
import { createSecureServer } from 'node:http2';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

/** Headers that apply to a single connection, and that a proxy must not forward. */
const HOP_BY_HOP_HEADERS = ['connection', 'keep-alive', 'transfer-encoding', 'upgrade'];

/** Starts a proxy in front of the service at this address, with a self-signed certificate; its own address is `url`. */
export async function startTlsProxy(address) {
  const { hostname, port } = new URL(address);
  const agent = new Agent({ keepAlive: true });
  const proxy = createSecureServer(certificate(), (received, answer) => {
    const headers = Object.fromEntries(Object.entries(received.headers).filter(([name]) => !name.startsWith(':')));
    headers.host = received.authority;
    const onward = request({ agent, hostname, port, method: received.method, path: received.url, headers }, reply => {
      const kept = Object.entries(reply.headers).filter(([name]) => !HOP_BY_HOP_HEADERS.includes(name));
      answer.writeHead(reply.statusCode, Object.fromEntries(kept));
      reply.pipe(answer);
    });
    onward.on('error', () => answer.stream.close());
    answer.on('close', () => onward.destroy()); // Ends an event stream at the service when the browser has left.
    received.pipe(onward);
  }).listen(0, '127.0.0.1');
  await once(proxy, 'listening');
  return { url: `https://127.0.0.1:${proxy.address().port}`, close: () => (proxy.close(), agent.destroy()) };
}

function certificate() {
  const folder = mkdtempSync(join(tmpdir(), 'trocar-certificate-'));
  try {
    const [keyout, out] = [join(folder, 'key.pem'), join(folder, 'certificate.pem')];
    const options = 'req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 1 -subj /CN=127.0.0.1';
    execFileSync('openssl', [...options.split(' '), '-keyout', keyout, '-out', out], { stdio: 'ignore' });
    return { key: readFileSync(keyout), cert: readFileSync(out) };
  } finally {
    rmSync(folder, { recursive: true });
  }
}
