FROM python:3.11-slim

ENV PYTHONUNBUFFERED=1 \
    PYTHONDONTWRITEBYTECODE=1 \
    PIP_NO_CACHE_DIR=1 \
    PIP_DISABLE_PIP_VERSION_CHECK=1 \
    NUMBA_CACHE_DIR=/tmp/numba \
    WILDSCENES_HOME=/data \
    WILDSCENES_GROUNDTRUTH=/groundtruth

WORKDIR /srv/wildscenes

COPY requirements.lock ./
RUN pip install --require-hashes -r requirements.lock

COPY pyproject.toml README.md LICENSE ./
COPY evaluator evaluator
COPY app app
COPY workers workers
COPY migrations migrations
RUN pip install --no-deps --no-build-isolation . \
    && rm -rf build ./*.egg-info evaluator app workers \
    && useradd --uid 10001 --user-group --no-create-home --home-dir /data --shell /usr/sbin/nologin wildscenes \
    && install -d -o wildscenes -g wildscenes /data /data/uploads /groundtruth

USER 10001
EXPOSE 8000

HEALTHCHECK --interval=10s --timeout=5s --start-period=30s --retries=3 \
    CMD ["python", "-c", "import urllib.request as r; r.urlopen('http://127.0.0.1:8000/api/v1/tracks', timeout=4)"]

CMD ["uvicorn", "app.asgi:app", "--host", "0.0.0.0", "--port", "8000", "--no-server-header", "--timeout-graceful-shutdown", "5"]
