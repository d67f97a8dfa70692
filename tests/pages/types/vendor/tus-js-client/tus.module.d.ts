// The part of tus-js-client 4 that the pages use.
interface TusResponse {
  getStatus(): number;
  getHeader(name: string): string | undefined;
  getBody(): string;
}

interface TusError extends Error {
  originalResponse?: TusResponse | null;
}

interface TusOptions {
  endpoint: string;
  uploadUrl?: string | null;
  chunkSize: number;
  retryDelays: number[];
  storeFingerprintForResuming: boolean;
  metadata: Record<string, string>;
  onUploadUrlAvailable(): void;
  onProgress(sent: number): void;
  onAfterResponse(request: unknown, response: TusResponse): void;
  onShouldRetry(error: TusError): boolean;
  onSuccess(): void;
  onError(error: TusError): void;
}

export class Upload {
  constructor(file: File, options: TusOptions);
  static terminate(url: string): Promise<void>;
  url: string | null;
  start(): void;
  abort(): Promise<void>;
}
