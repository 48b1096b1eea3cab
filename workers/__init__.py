"""The Celery application: tasks of a few lines that call `app`."""
