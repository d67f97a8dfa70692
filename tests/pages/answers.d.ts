// Types of the REST API's answers and bodies, by method and path. They come from the service's OpenAPI document.
import type { components, paths } from 'openapi';

declare global {
  /** The schemas of the OpenAPI document by name. */
  type Schemas = components['schemas'];

  type ApiMethod = 'GET' | 'PUT' | 'POST' | 'PATCH' | 'DELETE';

  /** The parts of a path after `/api/v1/`; a part that is not a literal text fits a `{parameter}` of the document. */
  type ApiPath = readonly string[];

  type ApiQuery = Record<string, string | number | boolean | null | undefined>;

  /** The JSON of a successful answer: null without content, `any` for a free-form object. */
  type ApiAnswer<M extends ApiMethod, P extends ApiPath> = JsonOf<Success<ApiOperation<M, P>>>;

  /** The JSON that an operation takes; undefined if it takes none. */
  type ApiBody<M extends ApiMethod, P extends ApiPath> = ApiOperation<M, P> extends
    { requestBody: { content: { 'application/json': infer Body } } } ? FreeForm<Body> : undefined;

  /** The query parameters of an operation; one that is null is left out of the address. */
  type ApiQueryOf<M extends ApiMethod, P extends ApiPath> =
    ApiOperation<M, P> extends { parameters: { query?: infer Query } } ? { [K in keyof Query]: Query[K] | null } : never;

  /** `P` if the document has the operation, else `never`: the call is then an error. */
  type KnownPath<M extends ApiMethod, P extends ApiPath> = [ApiOperation<M, P>] extends [never] ? never : P;

  /** An item of a list. */
  type ApiItem<P extends ApiPath> = ApiAnswer<'GET', P> extends { items: (infer Item)[] } ? Item : never;

  /** What `useLive` hands over, by the name of the event: the service's events, and two of the page itself. */
  interface LiveEvents {
    session: Extract<Schemas['EventData'], { status: unknown }>;
    job: Extract<Schemas['EventData'], { kind: unknown }>;
    queue: Extract<Schemas['EventData'], { queued: unknown }>;
    resync: undefined;
    state: string;
  }

  /** The usual operations on a resource; one that the service lacks answers `never`. */
  interface ApiResource<N extends string> {
    all(query?: ApiQueryOf<'GET', [N]>): Promise<ApiItem<[N]>[]>;
    page(query?: ApiQueryOf<'GET', [N]>, signal?: AbortSignal): Promise<ApiAnswer<'GET', [N]>>;
    get(id: string, signal?: AbortSignal): Promise<ApiAnswer<'GET', [N, string]>>;
    create(json: ApiBody<'POST', [N]>): Promise<ApiAnswer<'POST', [N]>>;
    change(id: string, json: ApiBody<'PATCH', [N, string]>): Promise<ApiAnswer<'PATCH', [N, string]>>;
    remove(id: string): Promise<null>;
  }
}

/** The operation of the document whose path has these parts. */
type ApiOperation<M extends ApiMethod, P extends ApiPath> = {
  [K in keyof paths]: K extends `/api/v1/${infer Rest}`
    ? Fits<P, Rest> extends true
      ? Exclude<paths[K][Lowercase<M> & keyof paths[K]], undefined>
      : never
    : never;
}[keyof paths];

/** Whether the parts of a path are those of `Rest`, which is divided by slashes. */
type Fits<P extends ApiPath, Rest extends string> = P extends readonly [infer Part, ...infer More extends ApiPath]
  ? Rest extends `${infer Segment}/${infer Others}`
    ? PartFits<Part, Segment> extends true
      ? Fits<More, Others>
      : false
    : More extends readonly []
      ? PartFits<Part, Rest>
      : false
  : false;

type PartFits<Part, Segment extends string> = string extends Part
  ? Segment extends `{${string}}`
    ? true
    : false
  : Part extends Segment
    ? true
    : false;

/** The successful response; of several, their union. */
type Success<Operation> = Operation extends { responses: infer Responses }
  ? Responses[keyof Responses & (200 | 201 | 202)]
  : never;

type JsonOf<Response> = [Response] extends [never]
  ? null
  : Response extends { content: { 'application/json': infer Json } }
    ? FreeForm<Json>
    : null;

type FreeForm<Json> = Json extends Record<string, never> ? any : Json;
