# Trocar as a container. One image builds the program, a small one runs it, not as root.
#
#   docker build -t trocar . && docker run --name trocar -p 8080:8080 -v trocar:/data trocar
#   docker exec trocar cat /data/administrator.password
#
# Both stages use Debian 12: FFmpeg's libraries must have the same major version at build time and at run time.
FROM rust:1.95-slim-bookworm AS build
RUN apt-get update -qq && apt-get install -y -qq --no-install-recommends \
    build-essential pkg-config clang libclang-dev libavcodec-dev libavformat-dev libavutil-dev libswscale-dev libswresample-dev \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /source
COPY Cargo.toml Cargo.lock ./
COPY migrations migrations
COPY static static
COPY measurement measurement
COPY src src
RUN cargo build --release --locked

FROM debian:bookworm-slim
# Debian's FFmpeg is a GPL build: an image that contains it is GPL as a whole (see README.md).
RUN apt-get update -qq && apt-get install -y -qq --no-install-recommends \
    libavcodec59 libavformat59 libavutil57 libswscale6 ca-certificates curl \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --uid 10001 --no-create-home --home-dir /data --shell /usr/sbin/nologin trocar \
    && install -d -o trocar -g trocar -m 0700 /data /backup
COPY --from=build /source/target/release/trocar /usr/local/bin/trocar
USER trocar
VOLUME /data
EXPOSE 8080
HEALTHCHECK --interval=30s --timeout=5s --start-period=10s CMD curl -fsSkL http://127.0.0.1:8080/readyz || exit 1
# The log of the container keeps what is printed, so the password is only in its file, whatever the command is.
ENV TROCAR_HIDE_PASSWORD=true
ENTRYPOINT ["/usr/local/bin/trocar"]
CMD ["serve", "--data", "/data", "--listen", "0.0.0.0:8080"]
