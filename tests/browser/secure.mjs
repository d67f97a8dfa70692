// What the README asks to be put in front of the service on a network: a TLS proxy, here one that speaks HTTP/2 as they all do.
import { execFileSync } from 'node:child_process';
import { once } from 'node:events';
import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { Agent, request } from 'node:http';
import { createSecureServer } from 'node:http2';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

/** Of one connection, and none of the next one's business. */
const HOP = ['connection', 'keep-alive', 'transfer-encoding', 'upgrade'];

/** In front of the service at this address, with a certificate that nobody signed; `url` is its own. */
export async function secured(address) {
  const { hostname, port } = new URL(address);
  const agent = new Agent({ keepAlive: true });
  const proxy = createSecureServer(certificate(), (asked, answer) => {
    const headers = Object.fromEntries(Object.entries(asked.headers).filter(([name]) => !name.startsWith(':')));
    headers.host = asked.authority;
    const onward = request({ agent, hostname, port, method: asked.method, path: asked.url, headers }, told => {
      const kept = Object.entries(told.headers).filter(([name]) => !HOP.includes(name));
      answer.writeHead(told.statusCode, Object.fromEntries(kept));
      told.pipe(answer);
    });
    onward.on('error', () => answer.stream.close());
    answer.on('close', () => onward.destroy()); // A stream of events ends with its reader.
    asked.pipe(onward);
  }).listen(0, '127.0.0.1');
  await once(proxy, 'listening');
  return { url: `https://127.0.0.1:${proxy.address().port}`, close: () => (proxy.close(), agent.destroy()) };
}

function certificate() {
  const folder = mkdtempSync(join(tmpdir(), 'trocar-certificate-'));
  try {
    const [keyout, out] = [join(folder, 'key.pem'), join(folder, 'certificate.pem')];
    const ask = 'req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 1 -subj /CN=127.0.0.1';
    execFileSync('openssl', [...ask.split(' '), '-keyout', keyout, '-out', out], { stdio: 'ignore' });
    return { key: readFileSync(keyout), cert: readFileSync(out) };
  } finally {
    rmSync(folder, { recursive: true });
  }
}
