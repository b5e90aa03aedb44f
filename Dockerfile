# docker build -t deformd .        what is in the image: the two programs and the libraries they load, a user, nothing else
FROM debian:bookworm-slim AS build
WORKDIR /src
COPY deploy/packages.txt deploy/install-packages deploy/
RUN deploy/install-packages build
COPY CMakeLists.txt CMakePresets.json ./
COPY cmake cmake
COPY proto proto
COPY core core
COPY server server
COPY client client
RUN cmake --preset release -DDEFORM_BUILD_TESTS=OFF -DDEFORM_BUILD_BENCH=OFF \
 && cmake --build --preset release --target deformd deform \
 && cmake --install build/release --prefix /opt/deformd --strip

FROM debian:bookworm-slim
COPY deploy/packages.txt deploy/install-packages /tmp/deploy/
RUN /tmp/deploy/install-packages runtime \
 && rm -rf /tmp/deploy /var/lib/apt/lists/* /var/cache/apt/* /var/log/apt /var/log/dpkg.log \
 && useradd --system --uid 10001 --user-group --no-create-home --home-dir /var/lib/deformd --shell /usr/sbin/nologin deformd \
 && install -d -o deformd -g deformd /var/lib/deformd
COPY --from=build /opt/deformd/bin/ /usr/local/bin/
USER 10001:10001
WORKDIR /var/lib/deformd
VOLUME /var/lib/deformd
EXPOSE 50051
STOPSIGNAL SIGTERM
# Asks the server whether it serves, as a client would.
HEALTHCHECK --interval=15s --timeout=6s --start-period=20s --retries=3 CMD ["deform", "--server", "127.0.0.1:50051", "status"]
ENTRYPOINT ["deformd"]
# Inside a container loopback reaches nobody, so it listens on all of the container's addresses, and there is no encryption yet:
# publish the port only to a network of its clients. Every option can also be set by environment (DEFORMD_MEMORY_BUDGET=8GiB).
CMD ["--data-dir", "/var/lib/deformd", "--insecure", "--address", "0.0.0.0:50051"]
