# SPDX-License-Identifier: GPL-3.0-or-later
# deformd and deform in a container:
#   docker build -t deformd .
#   docker run --rm -p 127.0.0.1:50051:50051 -v deformd-data:/var/lib/deformd deformd
# --build-arg POSTGRES=1: with deformd --catalog, for servers that share a store.
# deploy/compose.yaml runs the same with less privileges. Nothing of the build stays in the image.

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
 && cmake --build /build --target deformd deform manual \
 && cmake --install /build --strip --component tools --prefix /opt/deform \
 && cmake --install /build --strip --component server --prefix /opt/deform

FROM docker.io/library/debian:bookworm-slim
ARG COMMIT=
ARG POSTGRES=
LABEL org.opencontainers.image.title="deformd" \
      org.opencontainers.image.description="Server that deforms meshes for shape optimization, and its command line" \
      org.opencontainers.image.licenses="GPL-3.0-or-later" \
      org.opencontainers.image.revision="$COMMIT" \
      org.opencontainers.image.base.name="docker.io/library/debian:bookworm-slim"
COPY deploy/packages.txt deploy/install-packages /tmp/deploy/
RUN /tmp/deploy/install-packages runtime ${POSTGRES:+postgres-runtime} \
 && rm -rf /tmp/deploy /var/lib/apt/lists/* /var/cache/apt/*.bin /var/log/apt /var/log/dpkg.log \
 && useradd --system --uid 10001 --user-group --no-create-home --home-dir /nonexistent --shell /usr/sbin/nologin deformd \
 && install -d -o deformd -g deformd /var/lib/deformd
COPY --from=build /opt/deform /usr/local
COPY deploy/health-check /usr/local/bin/

# deformd listens on loopback unless told otherwise, and beyond it in plain text only when told --insecure. Inside a container it must
# listen on every address to be reached at all, and has no certificate, so both are said here. Who reaches it is decided outside:
# publish the port to 127.0.0.1 or to a private network, never to the open internet; or mount a certificate and set DEFORMD_TLS_CERT,
# DEFORMD_TLS_KEY and DEFORMD_IDENTITIES, and for the health check DEFORM_CA, DEFORM_TOKEN_FILE and DEFORM_SERVER_NAME. Change the address here, not by --address: the health check asks
# where DEFORMD_ADDRESS says.
ENV DEFORMD_ADDRESS=0.0.0.0:50051 \
    DEFORMD_INSECURE=true \
    DEFORMD_DATA_DIR=/var/lib/deformd
USER 10001:10001
VOLUME /var/lib/deformd
EXPOSE 50051
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=20s --timeout=18s --start-period=10s --retries=3 \
  CMD ["health-check"]
ENTRYPOINT ["deformd"]
