// A TCP proxy between browser and service whose connections a test can cut and restore.
import { once } from 'node:events';
import { connect, createServer } from 'node:net';

export class CuttableProxy {
  #isCut = false;
  #sockets = new Set();
  #server;

  /** Starts a proxy in front of the service at this address; the proxy's own address is `url`. */
  static async inFrontOf(address) {
    const { hostname, port } = new URL(address);
    const proxy = new CuttableProxy();
    proxy.#server = createServer(client => proxy.#pipe(client, connect(Number(port), hostname))).listen(0, '127.0.0.1');
    await once(proxy.#server, 'listening');
    proxy.url = `http://127.0.0.1:${proxy.#server.address().port}`;
    return proxy;
  }

  /** Closes all connections, and every new one until `restore()` is called. */
  cut() {
    this.#isCut = true;
    for (const socket of this.#sockets) socket.destroy();
  }

  restore() {
    this.#isCut = false;
  }

  close() {
    this.cut();
    this.#server.close();
  }

  #pipe(client, service) {
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
