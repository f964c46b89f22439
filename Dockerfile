# docker build --tag cascadenorm . && docker run --rm -v "$PWD:/data" cascadenorm denoise scan.ply
# docs/other-programs.md says more.
FROM python:3.12-slim

ENV PYTHONDONTWRITEBYTECODE=1
COPY . /opt/source
RUN pip install --no-cache-dir --config-settings kernels=none "/opt/source[formats]" && python /opt/source/release/compile_kernels.py
RUN useradd --uid 1000 --create-home mesh && install -d -o mesh /data
USER mesh
WORKDIR /data
ENTRYPOINT ["cascadenorm"]
CMD ["--help"]
