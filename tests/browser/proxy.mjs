// A network between browser and service that can be cut and mended.
import { once } from 'node:events';
import { connect, createServer } from 'node:net';

export class Proxy {
  #isCut = false;
  #sockets = new Set();
  #server;

  /** In front of the service at this address; `url` is its own. */
  static async before(address) {
    const { hostname, port } = new URL(address);
    const proxy = new Proxy();
    proxy.#server = createServer(client => proxy.#join(client, connect(Number(port), hostname))).listen(0, '127.0.0.1');
    await once(proxy.#server, 'listening');
    proxy.url = `http://127.0.0.1:${proxy.#server.address().port}`;
    return proxy;
  }

  /** Ends all connections; new ones are ended as well until it is mended. */
  cut() {
    this.#isCut = true;
    for (const socket of this.#sockets) socket.destroy();
  }

  mend() {
    this.#isCut = false;
  }

  close() {
    this.cut();
    this.#server.close();
  }

  #join(client, service) {
    for (const [socket, other] of [
      [client, service],
      [service, client],
    ]) {
      this.#sockets.add(socket);
      socket.on('error', () => other.destroy());
      socket.on('close', () => (this.#sockets.delete(socket), other.destroy()));
      if (this.#isCut) socket.destroy();
      else socket.pipe(other);
    }
  }
}
