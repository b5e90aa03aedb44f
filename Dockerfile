# SPDX-License-Identifier: GPL-3.0-or-later
# deformd in a container, in two images:
#   docker build -t deformd .                             deformd and deform, which reads and writes mesh files
#   docker build -t deformd-server --target server .      deformd alone, without the libraries of mesh files
#   docker run --rm -p 127.0.0.1:50051:50051 -v deformd-data:/var/lib/deformd deformd
# --build-arg POSTGRES=1: with deformd --catalog, for servers that share a store.
# --build-arg VERSION=... COMMIT=... CREATED=$(date -uIs) SOURCE=https://...: what the labels say.
# deploy/compose.yaml runs the same with less privileges. Nothing of the build stays in the images.

FROM docker.io/library/debian:bookworm-slim AS build
WORKDIR /src
COPY deploy/packages.txt deploy/install-packages deploy/
ARG POSTGRES=
RUN deploy/install-packages build ${POSTGRES:+postgres-build}
COPY CMakeLists.txt LICENSE ./
COPY deploy/cmake deploy/cmake
COPY deploy/manual deploy/manual
COPY deploy/systemd deploy/systemd
COPY deploy/debian deploy/debian
COPY docs/licenses docs/licenses
COPY proto proto
COPY core core
COPY server server
COPY client client
# What --version names; the sources here are no clone that could be asked.
ARG COMMIT=
RUN cmake -S . -B /build -G Ninja -DCMAKE_BUILD_TYPE=Release -DDEFORM_BUILD_TESTS=OFF -DDEFORM_COMMIT="$COMMIT" \
 && cmake --build /build --target programs manual \
 && cmake --install /build --strip --component tools --prefix /opt/tools \
 && cmake --install /build --strip --component server --prefix /opt/server

FROM docker.io/library/debian:bookworm-slim AS server
ARG POSTGRES=
COPY deploy/packages.txt deploy/install-packages /tmp/deploy/
RUN /tmp/deploy/install-packages runtime ${POSTGRES:+postgres-runtime} \
 && rm -rf /tmp/deploy /var/lib/apt/lists/* /var/cache/apt/*.bin /var/log/apt /var/log/dpkg.log \
 && useradd --system --uid 10001 --user-group --no-create-home --home-dir /nonexistent --shell /usr/sbin/nologin deformd \
 && install -d -o deformd -g deformd /var/lib/deformd
COPY --from=build /opt/server /usr/local
COPY deploy/health-check /usr/local/bin/

# deformd listens on loopback unless told otherwise, and beyond it in plain text only when told --insecure. Inside a container it must
# listen on every address to be reached at all, and has no certificate, so both are said here. Who reaches it is decided outside:
# publish the port to 127.0.0.1 or to a private network, never to the open internet; or mount a certificate and set DEFORMD_TLS_CERT,
# DEFORMD_TLS_KEY and DEFORMD_IDENTITIES. The health check asks /livez where DEFORMD_METRICS_ADDRESS says, so change the address
# here, not by --metrics-address.
ENV DEFORMD_ADDRESS=0.0.0.0:50051 \
    DEFORMD_METRICS_ADDRESS=127.0.0.1:9464 \
    DEFORMD_INSECURE=true \
    DEFORMD_DATA_DIR=/var/lib/deformd
USER 10001:10001
VOLUME /var/lib/deformd
EXPOSE 50051
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=20s --timeout=10s --start-period=10s --retries=3 \
  CMD ["health-check"]
ENTRYPOINT ["deformd"]
# Last, as they change with every build.
ARG VERSION=
ARG COMMIT=
ARG CREATED=
ARG SOURCE=
LABEL org.opencontainers.image.title="deformd" \
      org.opencontainers.image.description="Server that deforms meshes for shape optimization" \
      org.opencontainers.image.licenses="GPL-3.0-or-later" \
      org.opencontainers.image.version="$VERSION" \
      org.opencontainers.image.revision="$COMMIT" \
      org.opencontainers.image.created="$CREATED" \
      org.opencontainers.image.source="$SOURCE" \
      org.opencontainers.image.base.name="docker.io/library/debian:bookworm-slim"

FROM server
USER 0:0
COPY deploy/packages.txt deploy/install-packages /tmp/deploy/
RUN /tmp/deploy/install-packages runtime-tools \
 && rm -rf /tmp/deploy /var/lib/apt/lists/* /var/cache/apt/*.bin /var/log/apt /var/log/dpkg.log
COPY --from=build /opt/tools /usr/local
USER 10001:10001
LABEL org.opencontainers.image.description="Server that deforms meshes for shape optimization, and its command line"
