# docker build --tag cascadenorm . && docker run --rm -v "$PWD:/data" cascadenorm denoise scan.ply
# docs/other-programs.md says more.
FROM python:3.12-slim

# Kernels are compiled here, once, for any processor of this kind: x86-64-v3 has AVX2; generic for others
ARG CPU=x86-64-v3
ENV NUMBA_CPU_NAME=$CPU NUMBA_CPU_FEATURES="" NUMBA_CACHE_DIR=/opt/kernels PYTHONDONTWRITEBYTECODE=1

COPY . /opt/source
RUN pip install --no-cache-dir "/opt/source[formats]"
RUN useradd --uid 1000 --create-home mesh && install -d -o mesh /data "$NUMBA_CACHE_DIR"
USER mesh
RUN python /opt/source/container/compile_kernels.py

WORKDIR /data
ENTRYPOINT ["cascadenorm"]
CMD ["--help"]
